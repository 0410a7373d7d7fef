#!/usr/bin/env bash
# Bundle mam_sim/viewer/source.js with three.js (MIT) into viewer.js, which is committed; needs Node.js and npm.
set -euo pipefail
cd "$(dirname "$0")/.."
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cp mam_sim/viewer/source.js "$folder/"
(cd "$folder" && npm init -y >/dev/null && npm install --silent three@0.187.0 esbuild@0.28.2)
digest=$(sha256sum mam_sim/viewer/source.js | cut -d' ' -f1)
{
  echo "/*! Built by scripts/build_viewer.sh from source.js $digest"
  echo "with three.js, under this licence:"
  cat "$folder/node_modules/three/LICENSE"
  echo "*/"
  "$folder/node_modules/.bin/esbuild" "$folder/source.js" --bundle --minify --format=iife --target=es2020 --legal-comments=none
} > mam_sim/viewer/viewer.js
wc -c mam_sim/viewer/viewer.js
