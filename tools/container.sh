#!/bin/sh
# Entry point of the container: `serve` listens on every address, and therefore only with a token (MOTM_TOKEN, or one
# made here and printed once); every other command is motm-twin's own.
set -eu
if [ "${1:-serve}" != serve ]; then
  exec motm-twin "$@"
fi
[ $# -eq 0 ] || shift
if [ -z "${MOTM_TOKEN:-}" ]; then
  MOTM_TOKEN=$(python -c 'import secrets; print(secrets.token_urlsafe(32))')
  echo "token (set MOTM_TOKEN to choose it yourself): $MOTM_TOKEN"
fi
export MOTM_TOKEN
exec motm-twin serve "$@" --host 0.0.0.0
