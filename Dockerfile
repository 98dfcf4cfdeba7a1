# motm_twin in a container: `make image` builds and tries it; `docker build -t motm-twin .` works alone where there is
# a network. Run it: docker run --rm -p 8080:8080 -e MOTM_TOKEN=<at least 32 characters> motm-twin
FROM debian:bookworm-slim AS build
RUN apt-get update \
    && DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends ca-certificates python3 python3-venv \
    && rm -rf /var/lib/apt/lists/*
WORKDIR /src
# build/wheels is there when `make image` has fetched the locked packages in advance; then pip asks no network.
COPY requirements.lock requirements-build.lock build/wheel[s]/ /wheels/
COPY . /src
RUN set -eu; \
    python3 -m venv /opt/build; \
    python3 -m venv /opt/motm; \
    from=""; \
    if ls /wheels/*.whl >/dev/null 2>&1; then from="--no-index --find-links /wheels"; fi; \
    pip="--isolated --disable-pip-version-check install -q --no-cache-dir --only-binary :all: $from"; \
    /opt/build/bin/pip $pip --require-hashes -r requirements-build.lock; \
    /opt/build/bin/hatchling build -t wheel -d /dist; \
    /opt/motm/bin/pip $pip --require-hashes -r requirements.lock; \
    /opt/motm/bin/pip --isolated --disable-pip-version-check install -q --no-cache-dir --no-deps --no-index /dist/*.whl; \
    /opt/motm/bin/pip check; \
    /opt/motm/bin/python -m pip uninstall -q -y pip setuptools || true

FROM debian:bookworm-slim
RUN apt-get update \
    && DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends libgomp1 python3 \
    && rm -rf /var/lib/apt/lists/* \
    && useradd --uid 10001 --create-home --home-dir /var/lib/motm --shell /usr/sbin/nologin motm
COPY --from=build /opt/motm /opt/motm
COPY --chmod=755 tools/container.sh /usr/local/bin/motm-container
ENV PATH=/opt/motm/bin:/usr/local/bin:/usr/bin:/bin \
    PYTHONDONTWRITEBYTECODE=1 \
    NUMBA_CACHE_DIR=/var/lib/motm/numba \
    OMP_NUM_THREADS=1 \
    OPENBLAS_NUM_THREADS=1
USER motm
WORKDIR /var/lib/motm
# One whole trial, so that the kernels are compiled once here and not at every first start; an image in which the robot
# does not clear the table is not built.
RUN motm-twin run exp1 --variant trial1
EXPOSE 8080
HEALTHCHECK --interval=10s --timeout=5s --start-period=60s --retries=3 CMD ["python", "-m", "motm_twin.bus.health"]
ENTRYPOINT ["motm-container"]
CMD ["serve", "exp1"]
