"""Set-up check: does headless OpenGL work? If not, Mesa's EGL is installed where that is permitted.

Run by `python -m skinbake.preview.setup_gl` before anything is baked, so that a missing system library shows up in the
first minute. `make test` runs it with `testing`: the window's tests need a display, if only one in memory, those of the
page a browser; they are skipped without.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys

# Package manager -> what installs without asking
MANAGERS = {
    "apt-get": ["install", "-y", "--no-install-recommends"],
    "dnf": ["install", "-y"],
    "zypper": ["install", "-y"],
    "pacman": ["-S", "--noconfirm"],
    "apk": ["add"],
}
# What Mesa's EGL with its software rasteriser, and a display in memory, are called there
MESA = {
    "apt-get": ["libegl1", "libegl-mesa0", "libgl1", "libgl1-mesa-dri"],
    "dnf": ["mesa-libEGL", "mesa-libGL", "mesa-dri-drivers", "libglvnd-egl", "libglvnd-glx"],
    "zypper": ["Mesa-libEGL1", "Mesa-libGL1", "Mesa-dri"],
    "pacman": ["mesa", "libglvnd"],
    "apk": ["mesa-egl", "mesa-gl", "mesa-dri-gallium"],
}
XVFB = {
    "apt-get": ["xvfb"],
    "dnf": ["xorg-x11-server-Xvfb"],
    "zypper": ["xorg-x11-server-Xvfb"],
    "pacman": ["xorg-server-xvfb"],
    "apk": ["xvfb"],
}
CHROMIUM = {
    "apt-get": ["chromium"],
    "dnf": ["chromium"],
    "zypper": ["chromium"],
    "pacman": ["chromium"],
    "apk": ["chromium", "chromium-swiftshader"],
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


def install_commands(packages: dict[str, list[str]]) -> list[list[str]]:
    """Commands that install packages on this system, in order; empty where the package manager is not known."""
    for manager, verb in MANAGERS.items():
        if shutil.which(manager):
            first = [[manager, "update"]] if manager in ("apt-get", "apk") else []
            return [*first, [manager, *verb, *packages[manager]]]
    return []


def install(packages: dict[str, list[str]], missing: str) -> None:
    """Install where that is permitted without asking, and say so."""
    sudo = [] if _is_root() else ["sudo", "-n"]
    permitted = _is_root() or (
        shutil.which("sudo") and subprocess.run([*sudo, "true"], capture_output=True).returncode == 0
    )
    commands = install_commands(packages)
    if permitted and commands:
        print(f"{missing} is missing: installing it", flush=True)
        for command in commands:
            subprocess.run([*sudo, *command], stdout=subprocess.DEVNULL, check=False)


def by_hand(packages: dict[str, list[str]], otherwise: str) -> str:
    """Commands for a person to type, one a line."""
    sudo = "" if _is_root() else "sudo "
    commands = install_commands(packages) or [["<your package manager>", "install", otherwise]]
    return "\n".join("    " + sudo + " ".join(command) for command in commands)


def _is_root() -> bool:
    return hasattr(os, "geteuid") and os.geteuid() == 0


def see_to_gl() -> int:
    """Probe OpenGL, install it where permitted, probe again; 0 when it works, 3 when somebody must help."""
    name = renderer_name()
    if name is None:
        install(MESA, "headless OpenGL (Mesa's EGL)")
        name = renderer_name()
    if name is not None:
        print(f"headless OpenGL: {name}")
        return 0
    print("skinbake needs headless OpenGL (EGL with Mesa). Install it, then run make again:", file=sys.stderr)
    print(by_hand(MESA, "Mesa's libEGL and its software rasteriser"), file=sys.stderr)
    return 3


def see_to_testing() -> int:
    """Install Xvfb and Chromium where missing and permitted; always 0, since only a few tests are skipped without."""
    for name, programs, packages, tests in (
        ("Xvfb", ("Xvfb",), XVFB, "the window's tests"),
        ("Chromium", ("chromium", "chromium-browser", "google-chrome"), CHROMIUM, "the page's tests"),
    ):
        if sys.platform.startswith("linux") and not any(map(shutil.which, programs)):
            install(packages, f"{name}, which {tests} need,")
            if not any(map(shutil.which, programs)):
                print(f"{tests} will be skipped; to run them, install {name}:\n{by_hand(packages, name)}")
    return 0


if __name__ == "__main__":
    sys.exit(see_to_testing() if sys.argv[1:] == ["testing"] else see_to_gl())
