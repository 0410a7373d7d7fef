"""`mam-sim doctor`: what is installed, which backends are active, and the fix for each gap."""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
import sys
from dataclasses import asdict, dataclass
from importlib import metadata
from importlib.util import find_spec

from mam_pipeline.guarded import Limits, guarded
from mam_pipeline.optional import has
from mam_sim.console import Screen
from mam_sim.options import Verb

PACKAGES = ("numpy", "scipy", "trimesh", "open3d", "yourdfpy", "lightgbm")
EXTRAS = {
    "sapien": ("sim", "the simulator part of the check"),
    "mani-skill": ("sim", "robot environments"),
    "gymnasium": ("sim", "robot environments"),
    "torch": ("sim", "policies"),
    "stable-baselines3": ("rl", "reinforcement learning"),
    "lerobot": ("lerobot", "LeRobot datasets and policies"),
    "mujoco": ("mujoco", "MJCF export is read back with it"),
    "usd-core": ("usd", "USD files and export"),
    "meshopt": ("formats", "glTF packed by meshoptimizer"),
    "opengl-basisu": ("formats", "KTX2 textures"),
    "lib3mf": ("formats", "3MF files"),
    "openai": ("vlm", "vision-language reasoners"),
}


@dataclass(frozen=True)
class Finding:
    """One line: what, whether it is there, and what to do if it is not."""

    group: str
    name: str
    state: str
    ok: bool
    needed: bool = False
    fix: str = ""


@dataclass(frozen=True, kw_only=True)
class Doctor(Verb):
    """Say what works on this machine, what does not, and how to mend it.

    Exit status 1 when something that mam-sim cannot do without is missing.
    """

    json: bool = False
    """Print the findings as JSON."""

    def run(self) -> int:
        """Look at everything and print a line for each."""
        findings = [*_python(), *_packages(), *_system(), *_gpu(), *_backends(), *_models()]
        findings += [*_plugins(), *_keys(), *_sizes()]
        if self.json:
            Screen().json([asdict(f) for f in findings])
        else:
            _print(findings, Screen(self.quiet))
        return int(any(f.needed and not f.ok for f in findings))


def _print(findings: list[Finding], screen: Screen) -> None:
    group = ""
    for f in findings:
        if f.group != group:
            group = f.group
            screen.say(f"{group}")
        mark = "ok " if f.ok else ("NO " if f.needed else "-  ")
        screen.say(f"  {mark}{f.name:<24} {f.state}")
        if not f.ok and f.fix:
            first, *more = f.fix.splitlines()
            screen.say(f"      fix: {first}")
            for line in more:
                screen.say(f"           {line}")
    if any(f.needed and not f.ok for f in findings):
        screen.say("next:   the fixes of the lines that say NO")
    else:
        screen.next("make-env", "INPUT")


def _python() -> list[Finding]:
    ok = (3, 11) <= sys.version_info[:2] < (3, 13)
    fix = "use Python 3.11 or 3.12"
    return [
        Finding("system", "python", platform.python_version(), ok, True, fix),
        Finding("system", "machine", f"{platform.machine()}, {os.cpu_count()} cores", True),
    ]


def _version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


def _packages() -> list[Finding]:
    out = []
    for package in PACKAGES:
        version = _version(package)
        fix = "pip install mam-sim"
        out.append(Finding("packages", package, version or "missing", bool(version), True, fix))
    for package, (extra, use) in EXTRAS.items():
        fix = f"pip install 'mam-sim[{extra}]' ({use})"
        version = _version(package)
        out.append(Finding("packages", package, version or "not installed", bool(version), fix=fix))
    owners = [p for p in ("opencv-python", "opencv-python-headless") if _version(p)]
    out.append(
        Finding(
            "packages",
            "cv2",
            f"from {' and '.join(owners) or 'nobody'}",
            owners == ["opencv-python-headless"],
            not owners,
            "pip uninstall -y opencv-python; "
            "pip install --force-reinstall --no-deps opencv-python-headless",
        )
    )
    return out


def _system() -> list[Finding]:
    ffmpeg = shutil.which("ffmpeg")
    driver = vulkan_problem()
    return [
        Finding(
            "rendering",
            "ray-cast pictures",
            "Open3D on the CPU" if find_spec("open3d") else "missing",
            find_spec("open3d") is not None,
            True,
            "bash scripts/system_packages.sh (libusb-1.0-0, libgl1)",
        ),
        Finding(
            "rendering",
            "camera observations",
            driver or "SAPIEN finds a Vulkan device",
            driver is None,
            fix="a GPU driver, or Mesa >= 24.3: bash scripts/system_packages.sh",
        ),
        Finding(
            "rendering",
            "ffmpeg",
            ffmpeg or "missing",
            ffmpeg is not None,
            fix="apt-get install ffmpeg (videos in LeRobot datasets)",
        ),
    ]


def vulkan_problem() -> str | None:
    """None where SAPIEN can make a camera; else why not. Tried in a process of its own."""
    if not has("sapien"):
        return "SAPIEN is not installed"
    command = [sys.executable, "-c", "import sapien; sapien.render.RenderMaterial()"]
    done = subprocess.run(guarded(command, Limits(60)), capture_output=True, text=True)
    if done.returncode == 0:
        return None
    lines = [line for line in done.stderr.splitlines() if line.strip()]
    return lines[-1] if lines else f"the driver ended the process ({done.returncode})"


def _gpu() -> list[Finding]:
    if not has("torch"):
        return [Finding("gpu", "cuda", "torch is not installed", False)]
    try:
        import torch

        found = torch.cuda.is_available()
        name = torch.cuda.get_device_name(0) if found else "none; everything runs on the CPU"
    except Exception as error:  # a broken CUDA set-up must not break the doctor
        found, name = False, f"torch fails: {error}"
    return [Finding("gpu", "cuda", name, found)]


def _backends() -> list[Finding]:
    from mam_pipeline import backends
    from mam_pipeline.models import consent
    from mam_pipeline.registry import resolve

    out, offer = [], consent.model_offer()
    asked = offer is not None and consent.allowed(offer.who, "MAM_SIM_ALLOW_MODEL")
    for role in backends.BUILTIN:
        active = ""
        try:
            active = "vlm" if role == "reasoner" and asked else backends.load(role)[0]
        except Exception:  # told line by line below
            active = ""
        for name, target in backends.names(role).items():
            state, ok, fix = "", False, ""
            try:
                found = resolve(target, f"the {role} {name!r}").available()
                ok, fix = found.ok, found.why
                state = "active" if name == active else ("ready" if ok else "not available")
                if found.licence:
                    state += f"; licence: {found.licence}"
            except Exception as error:  # a third party's plug-in may be broken
                state = f"broken: {error}"
            out.append(Finding("backends", f"{role} {name}", state, ok, fix=fix))
    return out


def _plugins() -> list[Finding]:
    """What other packages add beside backends."""
    from mam_pipeline.registry import Registry

    out = []
    kinds = "robot", "task", "algorithm", "reader", "articulation", "exporter", "simulator_rules"
    for kind in kinds:
        added = Registry(kind, {})
        for name, target in added.targets().items():
            state, ok = target, True
            try:
                added.load(name)
            except Exception as error:  # it may fail at anything
                state, ok = f"broken: {error}", False
            out.append(Finding("plug-ins", f"{kind} {name}", state, ok))
    return out


def _models() -> list[Finding]:
    from mam_pipeline.backends import PACKAGES, names
    from mam_pipeline.models.catalogue import models

    out = []
    for model in models():
        found = model.look()
        state = f"{found.text}; {model.flag}; licence: {model.licence}"
        fix = "\n".join((*model.commands, f"see {model.page}"))
        out.append(Finding("models", model.name, state, found.ok, fix=fix))
    for package, roles in PACKAGES.items():
        if not all(set(known) <= set(names(role)) for role, known in roles.items()):
            fix = f"pip install ./{package} (in a clone)"
            out.append(Finding("models", package, "not installed", False, fix=fix))
    return out


def _sizes() -> list[Finding]:
    """What the installed packages take, the largest part first."""
    from mam_sim.installed_size import size_by_part

    found = size_by_part()
    rows = sorted(found.items(), key=lambda row: -row[1])
    rows.append(("total", sum(found.values())))
    return [Finding("disk", part, f"{size / 1e9:.2f} GB", True) for part, size in rows]


def _keys() -> list[Finding]:
    out = []
    for key in ("OPENAI_API_KEY", "OPENAI_BASE_URL", "HF_TOKEN"):
        there = bool(os.environ.get(key))
        out.append(Finding("keys", key, "set" if there else "not set", there))
    return out
