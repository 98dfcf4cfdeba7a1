#!/usr/bin/env bash
# Print the path of a Chromium for the browser tests, installing one where that is possible; exit 1 with a reason if not.
set -uo pipefail
cd "$(dirname "$0")/.."

found() {
  local name
  for name in "${MOTM_CHROMIUM:-}" chromium chromium-browser google-chrome-stable google-chrome; do
    if [ -n "$name" ] && command -v "$name"; then return 0; fi
  done
  return 1
}
of_playwright() {
  .venv/bin/python - <<'PY'
import sys
from pathlib import Path

from playwright.sync_api import sync_playwright

with sync_playwright() as playwright:
    path = Path(playwright.chromium.executable_path)
if not path.is_file():
    sys.exit(1)
print(path)
PY
}

# The reference pictures of the page are written in it.
if ! fc-list : family 2>/dev/null | grep 'Liberation Sans' >/dev/null; then  # -q would end fc-list by a signal
  tools/apt.sh fonts-liberation fontconfig >&2 || echo "chromium: without the font Liberation Sans" >&2
fi
found && exit 0
of_playwright && exit 0
echo "chromium: none found; trying the system's package" >&2
tools/apt.sh chromium >&2 && found && exit 0
echo "chromium: trying playwright's own build" >&2
timeout 300 .venv/bin/python -m playwright install chromium >&2 && of_playwright && exit 0
echo "chromium: none could be installed, so the browser tests are skipped" >&2
exit 1
