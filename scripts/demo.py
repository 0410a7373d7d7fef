"""The main job, start to end: a photo becomes an environment in which a robot arm opens it."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PHOTO = ROOT / "examples" / "nightstand.jpg"
OUT = ROOT / "demo_out"


def main() -> int:
    """Run make-env on the example photo, let the arm open it, say where everything lies."""
    started = time.monotonic()
    asset = OUT / "nightstand"
    command = [sys.executable, "-m", "mam_sim.cli", "make-env", str(PHOTO), "--out", str(asset)]
    shown = f"{PHOTO.relative_to(ROOT)} --out {asset.relative_to(ROOT)}"
    print(f"$ mam-sim make-env {shown}", flush=True)
    status = subprocess.run(command, cwd=ROOT).returncode
    if status:
        return status
    from mam_policies.demonstrate import demonstrate

    print("the arm opens it ...", flush=True)
    result = demonstrate(asset, out=OUT / "opened", seed=0)
    verdict = "opened" if result.success else f"did not open ({result.reason})"
    print(f"robot:    {result.joint} {verdict}")
    print(f"video:    {result.video} ({result.renderer})")
    print(f"pictures: {result.strip}")
    print(f"report:   {asset / 'report.html'}")
    print(f"took {time.monotonic() - started:.0f} s")
    return 0 if result.success else 1


if __name__ == "__main__":
    raise SystemExit(main())
