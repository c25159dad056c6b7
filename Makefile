# make bake        set up what is missing, bake and preview the sample head (CONFIG=configs/other.yaml for another)
# make test        set up what is missing and run every test
# make help        all targets
CONFIG ?= configs/head.yaml
BATCH ?= configs/looks.yaml
PYTHON ?= python3
OUT = out/$(basename $(notdir $(CONFIG)))

BIN := .venv/bin
SKINBAKE := $(BIN)/skinbake
READY := .venv/.ready
DATA := data/head.obj data/albedo.png data/normal.png data/roughness.png
# Where the test assets live when somebody put them beside the project; the README says how to get the scan.
export SKINBAKE_LPS ?= $(firstword $(wildcard data/lee_perry_smith ../shared/assets/lee_perry_smith))

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help install data bake preview batch tradeoff test check format golden golden-update bench clean

help:  ## list the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## /{printf "  make %-14s %s\n", $$1, $$2}' Makefile

install: $(READY)  ## make .venv, install the project, see that headless OpenGL works

$(READY): pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "skinbake needs Python 3.11 or newer: make PYTHON=python3.12 ..."; exit 1; }
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[dev,farm]'
	$(BIN)/python -m skinbake.preview.setup_gl
	@touch $@

data:  ## make the sample head anew from its script
	$(BIN)/python data/make_head.py --out data

bake: $(READY)  ## bake CONFIG and render its preview
	$(SKINBAKE) bake $(CONFIG)

preview: $(READY)  ## look at what the bake of CONFIG left
	$(SKINBAKE) preview $(OUT)

batch: $(READY)  ## bake every look of BATCH
	$(SKINBAKE) batch $(BATCH)

tradeoff: $(READY)  ## measure time and memory against error for CONFIG
	$(SKINBAKE) tradeoff $(CONFIG)

test: $(READY)  ## run every test
	$(BIN)/python -m pytest

check: $(READY)  ## linters and the type checker
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

format: $(READY)  ## put the code in its usual form
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

golden: $(READY)  ## compare with the golden EXRs
	$(BIN)/python -m pytest tests/golden

golden-update: $(READY)  ## renew the golden EXRs: look at each before committing it
	$(BIN)/python -m pytest tests/golden --golden-update

bench: $(READY)  ## benchmarks: ratios first
	$(BIN)/python -m tests.bench

clean:  ## remove what was baked (not .venv)
	rm -rf out tests/failures
