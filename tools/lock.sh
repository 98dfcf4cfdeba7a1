#!/usr/bin/env bash
# Resolve pyproject.toml into the four hashed lock files (needs network; run as `make lock`).
set -euo pipefail
cd "$(dirname "$0")/.."
tmp=$(mktemp -d)
trap 'rm -rf "$tmp"' EXIT
python3 -m venv "$tmp/uv"
"$tmp/uv/bin/pip" install -q uv
compile=("$tmp/uv/bin/uv" pip compile --quiet --upgrade --universal --python-version 3.11 --generate-hashes
  --no-header --no-annotate --no-emit-index-url --no-emit-find-links)
# The first line keeps hand edits away; none of the files may name an index (tests/project/test_lock.py).
header="# Made by tools/lock.sh from pyproject.toml; do not edit."
lock() { # lock NAME ARGS...: the dev lock comes first and pins the others
  local name=$1
  shift
  "${compile[@]}" "$@" -o "$tmp/$name"
  { echo "$header"; cat "$tmp/$name"; } >"$name"
}
lock requirements-dev.lock pyproject.toml --extra dev --extra docs
lock requirements.lock pyproject.toml -c requirements-dev.lock
echo "hatchling>=1.27" >"$tmp/build.in"
lock requirements-build.lock "$tmp/build.in" -c requirements-dev.lock
extras='import tomllib; print(*tomllib.load(open("pyproject.toml", "rb"))["project"]["optional-dependencies"]["docs"], sep="\n")'
python3 -c "$extras" >"$tmp/docs.in"
lock requirements-docs.lock "$tmp/docs.in" -c requirements-dev.lock
wc -l requirements*.lock
