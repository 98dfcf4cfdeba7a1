# motm_twin: `make run` sets up and starts Experiment 1; `make test` sets up and runs every test.
SHELL := /bin/bash
PYTHON_ENV := OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 MKL_NUM_THREADS=1
BIN := .venv/bin
SCENE ?= exp1
WORKERS ?= $(shell n=$$(nproc 2>/dev/null || echo 2); echo $$(( n < 2 ? 2 : n )))
TEST_WORKERS ?= $(shell echo $$(( $(WORKERS) + 1 ))) # tests wait for pages, programs and messages half of their time
TESTS ?= tests

.PHONY: help run test check quick format bench docs image wheel lock clean
.DEFAULT_GOAL := help

help: ## this list
	@grep -E '^[a-z]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*##/\t/' | expand -t 12

.venv/.ready-run: pyproject.toml requirements.lock requirements-build.lock
	@tools/setup.sh run

.venv/.ready-dev: pyproject.toml requirements-dev.lock
	@tools/setup.sh dev

.venv/.ready-docs: pyproject.toml requirements-docs.lock
	@tools/setup.sh docs

run: .venv/.ready-run ## set up, start the twin and its page (SCENE=exp1), print the address
	@$(PYTHON_ENV) $(BIN)/motm-twin serve $(SCENE) --loop $(ARGS)

test: .venv/.ready-dev ## set up (Chromium too, where it can be installed) and run every test
	@chromium=$$(tools/chromium.sh) || { \
	  if [ "$${MOTM_REQUIRE_BROWSER:-0}" = 1 ]; then echo "MOTM_REQUIRE_BROWSER=1, but there is no Chromium"; exit 1; fi; }; \
	$(PYTHON_ENV) MOTM_CHROMIUM="$$chromium" $(BIN)/python -m pytest -n $(TEST_WORKERS) --dist worksteal $(TESTS) $(ARGS)

check: .venv/.ready-dev ## formatting, lint and types; changes nothing
	@$(BIN)/ruff format --check .
	@$(BIN)/ruff check .
	@$(BIN)/pyright

format: .venv/.ready-dev ## format and apply the safe fixes
	@$(BIN)/ruff format .
	@$(BIN)/ruff check --fix .

bench: .venv/.ready-run ## the numbers of the paper and ours, as a table (all groups; GROUP=exp1 for one)
	@$(PYTHON_ENV) $(BIN)/motm-twin bench $(or $(GROUP),all) $(ARGS)

quick: .venv/.ready-dev ## the report of the paper's experiments with one trial of each kind, into out/quick
	@$(PYTHON_ENV) MOTM_CHROMIUM="$$(tools/chromium.sh)" $(BIN)/motm-twin paper --quick --workers $(WORKERS) --out out/quick

docs: .venv/.ready-docs ## build the documentation as a site into build/site, without the network
	@NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet $(ARGS)
	@echo "the site: build/site/index.html"

wheel: .venv/.ready-dev ## build the wheel into dist/
	@$(BIN)/python -m build --wheel --no-isolation --outdir dist .

image: ## build the container image with docker, podman or buildah, and try it
	@tools/image.sh

lock: ## resolve pyproject.toml into the hashed lock files
	@tools/lock.sh

clean: ## remove what the targets above made (.venv stays)
	@rm -rf build dist out .pytest_cache .ruff_cache .hypothesis
	@find . -name __pycache__ -not -path './.venv/*' -prune -exec rm -rf {} +
