# make run    the paper's scenario
# make test   lint, types, import contracts, tests; `.venv/bin/pytest -m "not slow"` for a quick check
# make system-packages   (Debian, as root) a browser and a software renderer; without them, the viewer tests are skipped
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

.PHONY: run test setup system-packages clean

run: setup
	$(BIN)/uvms-mj run --controller gsta

test: setup $(if $(CI),system-packages)
	$(BIN)/ruff check src tests scripts examples
	$(BIN)/ruff format --check src tests scripts examples
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/pytest -n 2 --dist worksteal

system-packages:
	-@if command -v apt-get >/dev/null && [ "$$(id -u)" = 0 ]; then apt-get update -qq && \
	  DEBIAN_FRONTEND=noninteractive apt-get install -y -qq chromium mesa-vulkan-drivers libvulkan1 >/dev/null; \
	  else echo "no apt-get, or not root: viewer tests may be skipped"; fi

setup: $(VENV)/.installed

$(VENV)/.installed: pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "uvms-mj needs Python 3.11 or newer; name one with make PYTHON=python3.12" >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --disable-pip-version-check --quiet --editable '.[dev]'
	$(BIN)/python -m compileall -q src # a quick start, also where Python is told to keep no byte code
	touch $@

clean:
	rm -rf $(VENV) .mypy_cache .pytest_cache .ruff_cache .hypothesis .import_linter_cache
