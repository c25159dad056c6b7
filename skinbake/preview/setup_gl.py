"""See that headless OpenGL works and install Mesa's EGL where that is permitted: `python -m skinbake.preview.setup_gl`.

Runs at set-up, before anything is baked, so that a missing system library shows up in the first minute.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys

# Package manager -> (what installs without asking, what Mesa's EGL and its software rasteriser are called there)
MANAGERS = {
    "apt-get": (["install", "-y", "--no-install-recommends"], ["libegl1", "libegl-mesa0", "libgl1", "libgl1-mesa-dri"]),
    "dnf": (["install", "-y"], ["mesa-libEGL", "mesa-libGL", "mesa-dri-drivers", "libglvnd-egl", "libglvnd-glx"]),
    "zypper": (["install", "-y"], ["Mesa-libEGL1", "Mesa-libGL1", "Mesa-dri"]),
    "pacman": (["-S", "--noconfirm"], ["mesa", "libglvnd"]),
    "apk": (["add"], ["mesa-egl", "mesa-gl", "mesa-dri-gallium"]),
}

# A context of the kind the preview makes, in a process of its own: a broken driver may take the process with it
_PROBE = """
import os
os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
import pyrender
from OpenGL.GL import GL_RENDERER, glGetString
renderer = pyrender.OffscreenRenderer(4, 4)
print(glGetString(GL_RENDERER).decode())
renderer.delete()
"""


def renderer_name() -> str | None:
    """Name of the headless OpenGL renderer, or None where no context can be made."""
    done = subprocess.run([sys.executable, "-c", _PROBE], capture_output=True, text=True, timeout=300, check=False)
    return done.stdout.strip().splitlines()[-1] if done.returncode == 0 and done.stdout.strip() else None


def install_commands() -> list[list[str]]:
    """What to run on this system, in order; empty for a system whose package manager we do not know."""
    for manager, (verb, packages) in MANAGERS.items():
        if shutil.which(manager):
            first = [[manager, "update"]] if manager in ("apt-get", "apk") else []
            return [*first, [manager, *verb, *packages]]
    return []


def main() -> int:
    """Probe, install where permitted, probe again; 0 when OpenGL works, 3 when somebody must help."""
    name = renderer_name()
    commands = install_commands()
    root = os.geteuid() == 0 if hasattr(os, "geteuid") else False
    sudo = [] if root else ["sudo", "-n"]
    permitted = root or (
        shutil.which("sudo") and subprocess.run(["sudo", "-n", "true"], capture_output=True).returncode == 0
    )
    if name is None and commands and permitted:
        print("headless OpenGL is missing: installing Mesa's EGL", flush=True)
        for command in commands:
            subprocess.run([*sudo, *command], stdout=subprocess.DEVNULL, check=False)
        name = renderer_name()
    if name is not None:
        print(f"headless OpenGL: {name}")
        return 0
    print("skinbake needs headless OpenGL (EGL with Mesa). Install it, then run make again:", file=sys.stderr)
    for command in commands or [["<your package manager>", "install", "Mesa's libEGL and its software rasteriser"]]:
        print("    " + " ".join([] if root else ["sudo"]) + " " * (not root) + " ".join(command), file=sys.stderr)
    return 3


if __name__ == "__main__":
    sys.exit(main())
