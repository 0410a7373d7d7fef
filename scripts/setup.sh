#!/usr/bin/env bash
# Make .venv with the pinned stack and the system libraries; a second run with nothing changed ends at once.
set -euo pipefail
cd "$(dirname "$0")/.."
say() { printf 'setup: %s\n' "$*" >&2; }

stamp=.venv/.mam-sim-setup
want=$(cat pyproject.toml constraints.txt scripts/setup.sh scripts/system_packages.sh | sha256sum | cut -d' ' -f1)
if [ -f "$stamp" ] && [ "$(cat "$stamp")" = "$want" ] && [ -x .venv/bin/python ]; then exit 0; fi

bash scripts/system_packages.sh

python=${PYTHON:-}
for p in python3.11 python3.12 python3; do [ -n "$python" ] || python=$(command -v "$p" || true); done
[ -n "$python" ] || { say "no python3 found; install Python 3.11 with its venv module"; exit 2; }
"$python" -c 'import sys; raise SystemExit(not ((3, 11) <= sys.version_info[:2] < (3, 13)))' ||
  { say "$("$python" --version) found, but Python 3.11 or 3.12 is needed; point PYTHON at one"; exit 2; }
need=12 free=$(df -Pk . | awk 'NR == 2 {print int($4 / 1048576)}')
if [ "$free" -lt "$need" ] && ! .venv/bin/python -c 'import open3d, torch' 2>/dev/null; then
  say "$need GB of free disk are needed at least, $free GB are left here"
  exit 2
fi
if [ ! -x .venv/bin/python ]; then
  "$python" -m venv .venv || { say "the venv module is missing; on Debian and Ubuntu: apt-get install python3-venv"; exit 2; }
fi

say "installing the pinned Python packages into .venv (12 GB once, several minutes)"
export PIP_DISABLE_PIP_VERSION_CHECK=1
# torch and its CUDA libraries first, by themselves: the wheels of one step are gone before the next is unpacked.
.venv/bin/python -m pip install --quiet --progress-bar off -c constraints.txt torch
.venv/bin/python -m pip install --quiet --progress-bar off -c constraints.txt -e ".[dev]"
.venv/bin/python -m pip install --quiet --progress-bar off --no-deps -e plugins/lerobot_policy_mam_sim -e plugins/lerobot_robot_mam_sim
# opencv-python (asked for by sapien) and opencv-python-headless (by lerobot) own the same cv2 folder:
# keep the headless one alone, which needs no display library.
if .venv/bin/python -m pip show -q opencv-python 2>/dev/null; then
  .venv/bin/python -m pip uninstall -y -q opencv-python
  .venv/bin/python -m pip install --quiet --progress-bar off --no-deps --force-reinstall -c constraints.txt opencv-python-headless
fi
.venv/bin/python -c 'import cv2, open3d, sapien, torch' || say "an import failed; see: .venv/bin/mam-sim doctor"
echo "$want" > "$stamp"
say "done; try: .venv/bin/mam-sim doctor"
