"""The page of the sample head in Chromium without a GPU: bytes, seconds to the first frame, frames a second of a drag.

`python -m tests.bench page`; it needs Chromium. Frames are counted by the fences that end them, which the page sets
for what it draws while something moves.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

from skinbake.cli import run as skinbake
from skinbake.export.web import NAME
from tests.export.browser import Browser

LOOK = Path(__file__).parents[2] / "configs" / "head.yaml"
DRAG_S = 8
_DRAG = """
const canvas = document.querySelector("canvas"), box = canvas.getBoundingClientRect();
const end = WebGL2RenderingContext.prototype.deleteSync;
let frames = 0;
WebGL2RenderingContext.prototype.deleteSync = function (frame) { frames += 1; return end.call(this, frame); };
const at = (kind, x) => canvas.dispatchEvent(new PointerEvent(kind, {
  pointerId: 1, isPrimary: true, bubbles: true, buttons: kind === "pointerup" ? 0 : 1,
  clientX: box.left + x, clientY: box.top + box.height / 2 }));
canvas.setPointerCapture = () => {};
const begun = performance.now();
at("pointerdown", 200);
for (let k = 0; performance.now() - begun < SECONDS * 1000; ++k) {
  at("pointermove", 200 + 150 * Math.sin(k / 40));
  await new Promise((r) => setTimeout(r, 16));
}
const took = (performance.now() - begun) / 1000;
at("pointerup", 200);
WebGL2RenderingContext.prototype.deleteSync = end;
return frames / took;
"""


def run(quick: bool) -> list[dict]:
    """A row for each size of the textures."""
    rows = []
    for size in (512,) if quick else (512, 1024, 2048):
        with tempfile.TemporaryDirectory() as folder:
            work = Path(folder)
            settings = [f"texture.size={size}", f"output.dir={work / 'bake'}", "diffusion.probes=200"]
            arguments = [word for each in settings for word in ("--set", each)]
            assert skinbake(["bake", str(LOOK), "--no-preview", "--quiet", *arguments]) == 0
            assert skinbake(["export", str(work / "bake"), "--to", str(work / "page"), "--web", "--quiet"]) == 0
            with Browser(work / "browser") as browser:
                begun = time.monotonic()
                browser.open(work / "page" / NAME)
                browser.run("await until(() => window.skinbake && skinbake.ready());")
                first = time.monotonic() - begun
                # The first drag finds out how coarse a frame must be
                _, frames = (browser.run(_DRAG.replace("SECONDS", str(DRAG_S))) for _ in range(2))
            megabytes = (work / "page" / NAME).stat().st_size / 1e6
            rows.append(
                {"name": f"{size} x {size}", "MB": megabytes, "first_frame_s": first, "frames_a_second": frames}
            )
    return rows
