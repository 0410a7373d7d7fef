#!/usr/bin/env bash
# Make .venv with the pinned stack and the system libraries; a second run with nothing changed ends at once.
#   setup.sh demo   what `make demo` needs: simulator and studio
#   setup.sh dev    everything, with tests, linters and the site (the default)
# PYTHON names the interpreter. MAM_SIM_TORCH_INDEX is the address of a package index with PyTorch's CPU wheels,
# which is asked where there is no CUDA device; without it PyTorch brings its CUDA libraries.
set -euo pipefail
cd "$(dirname "$0")/.."
say() { printf 'setup: %s\n' "$*" >&2; }

case "${1:-dev}" in
  demo) level=demo extras=sim,studio,formats gigabytes=10 ;;
  dev) level=dev extras=dev gigabytes=13 ;;
  *) say "no level '$1'; there are demo and dev"; exit 2 ;;
esac

stamp=.venv/.mam-sim-setup
digest=$(cat pyproject.toml plugins/*/pyproject.toml benchmarks/paper/pyproject.toml constraints.txt scripts/setup.sh scripts/system_packages.sh | sha256sum | cut -d' ' -f1)
if [ -f "$stamp" ] && [ -x .venv/bin/python ]; then
  case "$(cat "$stamp")" in "$digest dev" | "$digest $level") exit 0 ;; esac
fi

bash scripts/system_packages.sh

free=$(df -Pk . | awk 'NR == 2 {print int($4 / 1048576)}')
if [ "$free" -lt "$gigabytes" ] && ! .venv/bin/python -c 'import open3d, torch' 2>/dev/null; then
  say "$gigabytes GB of free disk are needed at least, $free GB are left here"
  exit 2
fi

# Only an interpreter that runs and can make environments counts: pyenv answers to every name that it knows.
usable() { "$1" -c 'import ensurepip, sys; raise SystemExit(not ((3, 11) <= sys.version_info[:2] < (3, 13)))' >/dev/null 2>&1; }
first() { for p in "$@"; do ! usable "$p" || { echo "$p"; return; }; done; }
pyenv=$(pyenv root 2>/dev/null || true)
if [ ! -x .venv/bin/python ]; then
  candidates=(python3.12 "$pyenv"/versions/3.12*/bin/python python3.11 "$pyenv"/versions/3.11*/bin/python python3)
  [ -z "${PYTHON:-}" ] || candidates=("$PYTHON")
  python=$(first "${candidates[@]}")
  [ -n "$python" ] ||
    { say "no Python 3.11 or 3.12 with its venv module at ${PYTHON:-hand}; docs/install.md says where to get one, PYTHON names one"; exit 2; }
  say "making .venv with $("$python" --version)"
  "$python" -m venv .venv
fi

say "installing the pinned Python packages [$extras] into .venv (up to $gigabytes GB once, several minutes)"
export PIP_DISABLE_PIP_VERSION_CHECK=1
install() { .venv/bin/python -m pip install --quiet --progress-bar off "$@"; }
# torch and its CUDA libraries first, by themselves: the wheels of one step are gone before the next is unpacked.
if .venv/bin/python -c 'import torch' 2>/dev/null; then
  :
elif nvidia-smi -L >/dev/null 2>&1; then
  install -c constraints.txt torch torchvision
elif [ -z "${MAM_SIM_TORCH_INDEX:-}" ]; then
  say "no CUDA device here; CPU wheels of PyTorch save over 5 GB where MAM_SIM_TORCH_INDEX says their index (docs/install.md)"
  install -c constraints.txt torch torchvision
elif ! install --extra-index-url "$MAM_SIM_TORCH_INDEX" -c constraints.txt torch torchvision; then
  say "the index of MAM_SIM_TORCH_INDEX gave no CPU wheels of PyTorch; taking those with CUDA libraries, over 5 GB more"
  install -c constraints.txt torch torchvision
fi
install -c constraints.txt -e ".[$extras]"
install --no-deps -e plugins/mam_sim_formats -e plugins/mam_sim_bench
[ $level = demo ] || install --no-deps -e plugins/lerobot_policy_mam_sim -e plugins/lerobot_robot_mam_sim -e plugins/mam_sim_models -e benchmarks/paper
# opencv-python (asked for by sapien) and opencv-python-headless (by lerobot) own the same cv2 folder:
# keep the headless one alone, which needs no display library.
if .venv/bin/python -m pip show -q opencv-python 2>/dev/null; then
  .venv/bin/python -m pip uninstall -y -q opencv-python
  install --no-deps --force-reinstall -c constraints.txt opencv-python-headless
fi
.venv/bin/python -c 'import cv2, open3d, sapien, torch' || say "an import failed; see: .venv/bin/mam-sim doctor"
# PyBullet has no wheel for Python 3.12: its tests reach it in an environment of 3.11, where there is one.
older=$(first python3.11 "$pyenv"/versions/3.11*/bin/python)
if [ $level = dev ] && [ -n "$older" ] && ! .venv/bin/python -c 'import pybullet' 2>/dev/null; then
  "$older" -m venv .venv/pybullet
  .venv/pybullet/bin/python -m pip install --quiet --progress-bar off -c constraints.txt pybullet numpy
fi
echo "$digest $level" > "$stamp"
say "done; try: .venv/bin/mam-sim doctor"
