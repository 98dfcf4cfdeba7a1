#!/usr/bin/env bash
# Make or update .venv from the hashed locks: `tools/setup.sh run` for users, `dev` for tests and checks, `docs` for the site.
set -euo pipefail
cd "$(dirname "$0")/.."
kind=${1:?run, dev or docs}

find_python() {
  local name
  for name in ${PYTHON:-} python3 python3.13 python3.12 python3.11; do
    if "$name" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
      command -v "$name"
      return
    fi
  done
  echo "motm_twin needs Python 3.11 or newer; set PYTHON=/path/to/python3 if it is not on the PATH." >&2
  return 1
}

if [ ! -x .venv/bin/python ]; then
  python=$(find_python)
  if ! "$python" -c 'import ensurepip' 2>/dev/null; then
    echo "setup: Python has no venv; installing Debian's python3-venv"
    tools/apt.sh python3-venv
  fi
  echo "setup: making .venv with $("$python" --version)"
  "$python" -m venv .venv
fi

pip() { .venv/bin/python -m pip --disable-pip-version-check "$@"; }
if [ "$kind" = docs ]; then
  echo "setup: installing the packages that build the site (about 20 MB the first time)"
  pip install -qq --require-hashes --only-binary :all: -r requirements-docs.lock
  touch .venv/.ready-docs
  exit
fi
echo "setup: installing the locked packages (about $([ "$kind" = dev ] && echo 350 || echo 200) MB the first time)"
if [ "$kind" = dev ]; then
  pip install -qq --require-hashes --only-binary :all: -r requirements-dev.lock
else
  pip install -qq --require-hashes --only-binary :all: -r requirements.lock
  pip install -qq --require-hashes --only-binary :all: -r requirements-build.lock
fi
pip install -qq --no-deps --no-build-isolation --editable .
if ! .venv/bin/python -c 'import pinocchio' 2>/dev/null; then
  echo "setup: pinocchio needs OpenMP's runtime; installing Debian's libgomp1"
  tools/apt.sh libgomp1
  .venv/bin/python -c 'import pinocchio'
fi
OMP_NUM_THREADS=1 .venv/bin/python -m motm_twin.warm_up
touch .venv/.ready-run
if [ "$kind" = dev ]; then
  if ! .venv/bin/python -m playwright --version >/dev/null 2>&1; then
    echo "setup: playwright's driver needs libatomic1; installing it"
    tools/apt.sh libatomic1 || echo "setup: without it the browser tests will fail"
  fi
  touch .venv/.ready-dev
fi
echo "setup: done"
