#!/usr/bin/env bash
# Install Debian packages without ever asking: as root, or with a sudo that needs no password; else say what to do.
set -euo pipefail
if [ "$(id -u)" = 0 ]; then
  as_root=()
elif sudo -n true 2>/dev/null; then
  as_root=(sudo -n)
else
  echo "Please install: $*   (for instance: sudo apt-get install $*)" >&2
  exit 1
fi
if ! command -v apt-get >/dev/null; then
  echo "Please install with your system's package manager: $*" >&2
  exit 1
fi
export DEBIAN_FRONTEND=noninteractive
"${as_root[@]}" apt-get update -qq
"${as_root[@]}" apt-get install -y -qq --no-install-recommends "$@" >/dev/null
