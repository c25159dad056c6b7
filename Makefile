# make bake        set up what is missing, bake and preview the sample head (CONFIG=configs/other.yaml for another)
# make test        set up what is missing and run every test
# make quick       the tests worth running after each edit
# make help        all targets
CONFIG ?= configs/head.yaml
BATCH ?= configs/looks.yaml
PYTHON ?= python3
TESTERS ?= 2
# Testers have a processor each: the threads of BLAS would wait for one another. What they start, a hundred processes,
# finds modules compiled, also where the environment says that Python is to leave none.
ALONE := OPENBLAS_NUM_THREADS=1 PYTHONDONTWRITEBYTECODE=

# A path as one word for the shell, whatever is in it
QUOTED = '$(subst ','\'',$(1))'

BIN := .venv/bin
SKINBAKE := $(BIN)/skinbake
READY := .venv/.ready
DATA := data/head.obj data/albedo.png data/normal.png data/roughness.png data/melanin.png data/haemoglobin.png data/cavity.png
# Where the test assets live when somebody put them beside the project; the README says how to get the scan.
export SKINBAKE_LPS ?= $(abspath $(firstword $(wildcard data/lee_perry_smith ../shared/assets/lee_perry_smith)))

# Stage files are targets: `make out/head/bake.json`, `make -j2 out/looks/classic-warm/bake.json ...` do what is stale.
CODE := $(shell find skinbake -name '*.py' -o -name '*.frag' -o -name '*.vert')
LIGHT_CODE := $(filter skinbake/atlas/% skinbake/irradiance/% skinbake/io/% skinbake/kernels/% skinbake/scene/%,$(CODE)) $(wildcard skinbake/*.py)
SKINS := $(wildcard configs/skins/*.yaml)
PARTS := $(sort $(patsubst tests/%/,%,$(dir $(wildcard tests/*/test_*.py tests/*/*/test_*.py))))
BATCHES := $(basename $(notdir $(shell grep -lE '^(jobs|matrix):' configs/*.yaml)))
# -jN of make, for the one process that bakes many
J = $(or $(patsubst -j%,%,$(firstword $(filter -j%,$(MAKEFLAGS)))),1)

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PRECIOUS: out/%/bake.json out/%/irradiance.exr
.PHONY: help install data bake preview batch tradeoff test quick faults check format golden golden-update bench clean

help:  ## list the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## /{printf "  make %-14s %s\n", $$1, $$2}' Makefile
	@printf '  %s\n' 'The tests of one part: $(BIN)/python -m pytest tests/PART, with one of these for PART:' '    $(PARTS)'

install: $(READY)  ## make .venv, install the project, see that headless OpenGL works

$(READY): pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "skinbake needs Python 3.11 or newer: make PYTHON=python3.12 ..."; exit 1; }
	$(PYTHON) -m venv .venv
	@$(BIN)/python -m skinbake.install -e '.[dev,farm]'
	$(BIN)/python -m skinbake.preview.setup_gl
	@touch $@

data:  ## make the sample head anew from its script
	$(BIN)/python data/make_head.py --out data

bake: $(READY)  ## bake CONFIG and render its preview
	$(SKINBAKE) bake $(call QUOTED,$(CONFIG))

preview: $(READY)  ## look at what the bake of CONFIG left
	$(SKINBAKE) preview $(call QUOTED,$(CONFIG))

batch: $(READY)  ## bake every look of BATCH, with -jN on N processes
	$(SKINBAKE) batch $(call QUOTED,$(BATCH)) -j $(J)

out/%/irradiance.exr: configs/%.yaml $(DATA) $(LIGHT_CODE) | $(READY)
	$(SKINBAKE) irradiance $< --out $(@D)
	@touch -c $@

out/%/bake.json: configs/%.yaml out/%/irradiance.exr $(DATA) $(SKINS) $(CODE) | $(READY)
	$(SKINBAKE) bake $< --out $(@D)
	@$(SKINBAKE) info $(@D) --make >$(@D)/bake.d

define BATCH_RULE
out/$(1)/%/bake.json: configs/$(1).yaml $$(wildcard configs/*.yaml) $$(DATA) $$(SKINS) $$(CODE) | $$(READY)
	$$(SKINBAKE) batch $$< --out out/$(1) --only '$$*'
	@$$(SKINBAKE) info $$(@D) --make >$$(@D)/bake.d
endef
$(foreach batch,$(BATCHES),$(eval $(call BATCH_RULE,$(batch))))

# What else each bake has read: meshes and maps that lie elsewhere
-include $(wildcard out/*/bake.d out/*/*/bake.d)

tradeoff: $(READY)  ## measure time and memory against error for CONFIG
	$(SKINBAKE) tradeoff $(call QUOTED,$(CONFIG))

test: $(READY) .venv/.testing  ## run every test, on TESTERS processes
	$(ALONE) $(BIN)/python -m pytest -n $(TESTERS) --dist worksteal

quick: $(READY)  ## the tests worth running after each edit
	$(ALONE) $(BIN)/python -m pytest -n $(TESTERS) --dist worksteal -m 'not slow'

.venv/.testing: | $(READY)
	@$(BIN)/python -m skinbake.preview.setup_gl testing
	@touch $@

faults: $(READY)  ## kill bakes, batches, sequences and exports, fifty times and before every step on the disk; press Ctrl-C a hundred times
	SKINBAKE_KILLS=50 SKINBAKE_STOPS=34 $(BIN)/python -m pytest tests/cli/test_faults.py tests/cli/test_interrupt.py

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
