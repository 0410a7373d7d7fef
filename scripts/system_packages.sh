#!/usr/bin/env bash
# Install the system libraries that mam-sim uses, when root or password-less sudo is at hand; otherwise print the line to run.
# Nothing here is fatal: without a library the project goes on with what works, and `mam-sim doctor` says what is missing.
set -u
say() { printf 'setup: %s\n' "$*" >&2; }
command -v apt-get >/dev/null 2>&1 || { say "not an apt system: install libusb-1.0, libGL, FFmpeg and a Vulkan driver (Mesa >= 24.3) by hand"; exit 0; }

have() { dpkg-query -W -f='${Status}' "$1" 2>/dev/null | grep -q 'install ok installed'; }
mesa_version() { dpkg-query -W -f='${Version}' mesa-vulkan-drivers 2>/dev/null; }
mesa_new_enough() { v=$(mesa_version); [ -n "$v" ] && dpkg --compare-versions "$v" ge 24.3; }

. /etc/os-release
browser=(); [ "${ID:-}" != debian ] || browser=(chromium)  # for the tests of the studio; Ubuntu's is a snap
missing=()
for p in libusb-1.0-0 libgl1 libgomp1 ffmpeg libvulkan1 "${browser[@]}"; do have "$p" || missing+=("$p"); done
[ ${#missing[@]} -eq 0 ] && mesa_new_enough && exit 0

if [ "$(id -u)" = 0 ]; then root=(); elif sudo -n true 2>/dev/null; then root=(sudo -n); else
  say "some system libraries are missing; run this once and start again:"
  say "  sudo bash $(cd "$(dirname "$0")" && pwd)/system_packages.sh"
  say "going on without them"
  exit 0
fi
export DEBIAN_FRONTEND=noninteractive
"${root[@]}" apt-get update -qq || say "apt-get update failed; trying with the lists at hand"
if [ ${#missing[@]} -gt 0 ]; then
  say "installing ${missing[*]}"
  "${root[@]}" apt-get install -y -qq --no-install-recommends "${missing[@]}" >/dev/null || say "apt-get could not install: ${missing[*]}"
fi
mesa_new_enough && exit 0

suite="${VERSION_CODENAME:-}-backports"
candidate=$(apt-cache policy mesa-vulkan-drivers | awk '/Candidate:/{print $2}')
if dpkg --compare-versions "${candidate:-0}" ge 24.3; then
  "${root[@]}" apt-get install -y -qq --no-install-recommends mesa-vulkan-drivers >/dev/null
elif [ "${ID:-}" = debian ]; then
  # The mirror is the one that this machine already uses for its release; only the suite is new.
  if ! apt-cache policy | grep -q "n=$suite"; then
    site=$(apt-get indextargets --format '$(CREATED_BY)|$(SITE)|$(RELEASE)' 2>/dev/null |
      awk -F'|' -v r="$VERSION_CODENAME" '$1=="Packages" && $3==r {print $2; exit}')
    key=/usr/share/keyrings/debian-archive-keyring.gpg; [ -f "$key" ] || key=
    if [ -n "$site" ]; then
      printf 'deb %s%s %s main\n' "${key:+[signed-by=$key] }" "$site" "$suite" |
        "${root[@]}" tee /etc/apt/sources.list.d/mam-sim-backports.list >/dev/null
      "${root[@]}" apt-get update -qq || true
    fi
  fi
  "${root[@]}" apt-get install -y -qq --no-install-recommends -t "$suite" mesa-vulkan-drivers libgbm1 >/dev/null ||
    say "$suite has no newer Mesa here"
fi
mesa_new_enough || say "Mesa $(mesa_version) is older than 24.3: SAPIEN's cameras stay off on this CPU; everything else works"
exit 0
