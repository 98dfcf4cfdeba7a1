#!/usr/bin/env bash
# Build the container image with docker, podman or buildah, whichever works here, and try it: list the scenes, serve,
# and ask the health check. Where no image registry is reachable, buildah gets its base from debootstrap.
set -euo pipefail
cd "$(dirname "$0")/.."
image=motm-twin
base=debian:bookworm-slim
port=${MOTM_SMOKE_PORT:-18080}

engine() {
  local name
  for name in ${MOTM_ENGINE:-docker podman buildah}; do
    case $name in
      docker | podman) if timeout 20 "$name" info >/dev/null 2>&1; then echo "$name" && return; fi ;;
      buildah) if command -v buildah >/dev/null; then echo buildah && return; fi ;;
    esac
  done
  tools/apt.sh buildah debootstrap >&2 && echo buildah
}

# Debian bookworm has Python 3.11: with the same Python here, the locked packages are fetched outside the image, so
# that whatever pip needs to know of this machine's network stays out of it.
fetch_wheels() {
  local python
  mkdir -p build/wheels
  for python in .venv/bin/python python3 python3.11; do
    if "$python" -c 'import sys, pip; sys.exit(sys.version_info[:2] != (3, 11))' 2>/dev/null; then
      echo "image: fetching the locked packages"
      for lock in requirements.lock requirements-build.lock; do
        "$python" -m pip --disable-pip-version-check download -qq --require-hashes --only-binary :all: \
          -r "$lock" -d build/wheels
      done
      return
    fi
  done
  echo "image: no Python 3.11 here; the build fetches its packages itself"
}

# vfs and chroot need neither overlay mounts nor an engine.
with_buildah() { buildah --storage-driver "${MOTM_STORAGE_DRIVER:-vfs}" "$@"; }

base_for_buildah() {
  if with_buildah inspect --type image "$base" >/dev/null 2>&1; then return; fi
  if timeout 60 buildah --storage-driver "${MOTM_STORAGE_DRIVER:-vfs}" pull -q "docker.io/library/$base" >/dev/null 2>&1; then
    with_buildah tag "docker.io/library/$base" "$base"
    return
  fi
  echo "image: no image registry answers; making $base with debootstrap"
  command -v debootstrap >/dev/null || tools/apt.sh debootstrap
  local root container
  root=$(mktemp -d)
  debootstrap --variant=minbase bookworm "$root" >"$root.log" || { tail -20 "$root.log" >&2; exit 1; }
  rm -rf "$root"/var/cache/apt/archives/*.deb "$root"/var/lib/apt/lists/* "$root"/usr/share/{doc,man,locale}/*
  container=$(with_buildah from scratch)
  with_buildah add -q "$container" "$root" / >/dev/null
  with_buildah config --cmd bash "$container"
  with_buildah commit -q --rm "$container" "$base" >/dev/null
  rm -rf "$root" "$root.log"
}

build() {
  case $engine in
    buildah)
      base_for_buildah
      with_buildah build --isolation chroot --format docker --pull-never -t "$image" .
      ;;
    podman) podman build --format docker -t "$image" . ;;
    docker) docker build -t "$image" . ;;
  esac
}

# inside COMMAND: a shell command in a fresh container of the image, as its own user.
inside() {
  case $engine in
    buildah)
      local container code=0
      container=$(with_buildah from --pull-never "$image")
      with_buildah run --isolation chroot "$container" -- sh -c "$1" || code=$?
      with_buildah rm "$container" >/dev/null
      return $code
      ;;
    *) "$engine" run --rm --entrypoint sh "$image" -c "$1" ;;
  esac
}

engine=$(engine)
echo "image: building with $engine"
fetch_wheels
build
echo "image: smoke run"
inside 'test "$(id -u)" != 0 && motm-twin scene list'
inside "
  export MOTM_TOKEN=smoke-run-token-of-at-least-32-characters
  motm-container serve exp1 --port $port >/tmp/serve.log 2>&1 &
  server=\$!
  code=1
  for second in \$(seq 120); do
    sleep 1
    if python -m motm_twin.bus.health 2>/dev/null && grep -q 'Page:' /tmp/serve.log; then
      python - <<'PY' && code=0
import os, urllib.error, urllib.request
page = 'http://127.0.0.1:$port/'
assert urllib.request.urlopen(page + 'healthz').status == 200
try:
    urllib.request.urlopen(page)
    raise SystemExit('the page is served without its token')
except urllib.error.HTTPError as refusal:
    assert refusal.code == 401, refusal
browser = urllib.request.build_opener(urllib.request.HTTPCookieProcessor())
assert b'<html' in browser.open(page + '?token=' + os.environ['MOTM_TOKEN']).read().lower()
PY
      [ \$code = 0 ] && echo \"image: healthy after \$second s; the page is served with its token only\"
      break
    fi
    kill -0 \$server 2>/dev/null || break
  done
  [ \$code = 0 ] || cat /tmp/serve.log
  kill \$server 2>/dev/null
  wait \$server
  exit \$code
"
echo "image: $image is ready: docker run --rm -p 8080:8080 -e MOTM_TOKEN=... $image"
