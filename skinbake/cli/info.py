"""`skinbake info FILE|FOLDER`: where it came from, and whether that is still there."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from skinbake.cli.options import json_option
from skinbake.errors import InputError, printable

if TYPE_CHECKING:
    from skinbake.scene.spec import SceneSpec

LONGEST = 200  # characters of a header's value that are shown
_UNQUOTABLE = re.compile(r"[%;=|\\]|[ &]$|\(.*\)$")


@click.command("info")
@click.argument("path", type=click.Path())
@click.option("--make", "as_rule", is_flag=True, help="As a rule for make: what the bake in this folder depends on.")
@json_option
def command(path: str, as_rule: bool, as_json: bool) -> None:
    """Show version, inputs, lobes, error and plan of a bake folder, the looks of a batch, or the header of one file."""
    from skinbake.io import batch_report
    from skinbake.io.exr import read_attributes
    from skinbake.io.manifest import NAME, read_manifest, spec_of

    file = Path(path)
    folder = file.parent if file.name == NAME else file
    if (folder / batch_report.NAME).is_file() and not (folder / NAME).is_file():
        batch = batch_report.read_batch_report(folder)
        print(json.dumps(batch, indent=1) if as_json else printable("\n".join(_batch(batch))))
        return
    if not folder.is_dir():
        headers = read_attributes(file)
        print(json.dumps(headers, indent=1, default=str) if as_json else printable("\n".join(_headers(headers))))
        return
    manifest = read_manifest(folder)
    spec = spec_of(manifest, folder)
    if as_rule:
        print(_rule(folder, spec))
        return
    inputs = input_states(manifest, spec)
    if as_json:
        print(json.dumps(manifest | {"input_states": inputs}, indent=1, default=str))
    else:
        print(printable("\n".join(_bake(manifest, inputs))))


def input_states(manifest: dict[str, Any], spec: SceneSpec) -> dict[str, dict[str, str]]:
    """Path of each input by role, and its state now: `as baked`, `changed` or `missing`."""
    from skinbake.io.fingerprint import digest_of, input_files

    states = {}
    for role, recorded in manifest["inputs"].items():
        try:
            paths = input_files(spec)[role]
            now = digest_of(spec, role, paths)
            state = "as baked" if now == recorded else "changed"
        except (InputError, KeyError):
            paths, state = (), "missing"
        states[role] = {"path": ", ".join(map(str, paths)), "state": state, "sha256": recorded}
    return states


def _bake(manifest: dict[str, Any], inputs: dict[str, dict[str, str]]) -> list[str]:
    lines = [f"skinbake {manifest['version']}, lights {', '.join(manifest['lights'])}", "inputs"]
    lines += [f"  {role:<12} {i['state']:<9} {i['sha256'][:12]}  {i['path']}" for role, i in inputs.items()]
    lines.append("lobes")
    for lobe in manifest["lobes"]:
        weight = ", ".join(f"{w:.4g}" for w in lobe["weight_rgb"])
        size = "x".join(map(str, lobe["size"]))
        variance = lobe["variance_mm2"]
        lines.append(f"  {lobe['file']:<18} {variance:>9.4g} mm^2  {lobe['method']:<9} {size:<10} weights {weight}")
    lines.append("plan")
    lines += [f"  {'+' if line['kept'] else '-'} {line['term']:<20} {line['why']}" for line in manifest["plan"]]
    from skinbake.scene.decision import uncounted_words

    error = manifest["error"] or {}
    if "rms" in error:
        lines.append(
            f"blur     rms {error['rms']:.3%}, p95 {error['p95']:.3%}, max {error['max']:.3%}, "
            f"{error['probes']} probes (method {error['method']:.3%}, storage {error['storage']:.3%}, "
            f"fit {', '.join(f'{e:.2%}' for e in error['fit'])})"
        )
    if "left_wrong" in error:
        lines.append(f"in all   rms {error['left_wrong']:.3%}: the blur, the texture's size and terms left out")
    if uncounted := uncounted_words(manifest["plan"]):
        lines.append(f"beside   {uncounted}")
    if model := error.get("model"):
        from skinbake.transport.model_error import rms_words

        rms = rms_words(model["rms"], model["stderr"])
        lines.append(f"model    rms {rms}, against light transport, {model['points']} points")
    if manifest["timings"]:
        lines.append("seconds  " + ", ".join(f"{stage} {s:.2f}" for stage, s in manifest["timings"].items()))
    if manifest["peak_memory_mib"]:
        lines.append(f"memory   {manifest['peak_memory_mib']:.0f} MiB at most")
    return lines


def _batch(batch: dict[str, Any]) -> list[str]:
    lines = [f"skinbake {batch['version']}, {len(batch['jobs'])} looks of {batch['file']}"]
    for job in batch["jobs"]:
        text = job.get("error") if job["status"] in ("failed", "missed") else job.get("note")
        lines.append(f"  {job['name']:<28} {job['status']:<8} {text or ''}".rstrip())
    return lines


def _headers(headers: dict[str, dict[str, Any]]) -> list[str]:
    """What all parts say, once, and then what each says itself; of what is long the beginning."""
    first, *others = headers.values()
    shared = {key for key in first if others and all(key in of and of[key] == first[key] for of in others)}
    blocks = {"every part": {key: first[key] for key in shared}} if shared else {}
    blocks |= {part or "image": {key: header[key] for key in header if key not in shared}
               for part, header in headers.items()}  # fmt: skip
    lines = []
    for name, header in blocks.items():
        lines.append(name)
        lines += [f"  {key:<24} {_short(str(value))}" for key, value in sorted(header.items())]
    return lines


def _short(text: str) -> str:
    more = len(text) - LONGEST
    return text if more <= 0 else f"{text[:LONGEST]} ... and {more} characters more; --json has them"


def _rule(folder: Path, spec: SceneSpec) -> str:
    """`bake.json irradiance.exr: inputs`; an input that has vanished is no error of make's but of the next bake's."""
    from skinbake.io.fingerprint import input_files

    paths = sorted({make_name(path) for files in input_files(spec).values() for path in files})
    targets = " ".join(make_name(folder / name) for name in ("bake.json", "irradiance.exr"))
    return "\n".join([f"{targets}: {' '.join(paths)}", *(f"{path}:" for path in paths)])


def make_name(path: Path) -> str:
    """A path as a word of a makefile's rule that stands for itself, whatever is in it.

    Raises
    ------
    InputError
        It holds what no rule can quote: it would be a pattern, a recipe, a variable, a member of an archive.
    """
    text = path.as_posix()
    if not text.isprintable() or _UNQUOTABLE.search(text):
        raise InputError(f"info --make: expected paths that a makefile can name, got {text!r}; rename it")
    return re.sub(r"([ #:*?\[])", r"\\\1", text).replace("$", "$$")
