# make run    the paper's scenario
# make test   lint, types, import contracts, tests; `.venv/bin/pytest -m bits -n 2 --dist loadfile` for each commit
# make docs   the site, in docs/_build/html; warnings are errors. make docs-serve shows it at http://127.0.0.1:8000
# make system-packages   (Debian, as root) a browser, software renderers and qemu; without them, tests of viewers, videos and other processors are skipped
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
export PYTHONDONTWRITEBYTECODE := # byte code of what is imported is kept, also where Python is told to keep none

.PHONY: run test checks suite docs docs-serve setup system-packages clean

run: setup
	$(BIN)/uvms-mj run --controller gsta

test: checks suite # at once with make -j 2

checks: setup
	$(BIN)/ruff check src tests scripts examples docs
	$(BIN)/ruff format --check src tests scripts examples docs
	$(BIN)/pyrefly check
	$(BIN)/lint-imports

suite: setup $(if $(CI),system-packages)
	$(BIN)/pytest -n 3 --dist loadfile --no-loadscope-reorder $(if $(CI),--durations=30) # three for two cores: some tests wait

docs: setup
	$(BIN)/sphinx-build -W --keep-going -q -d docs/_build/doctrees docs docs/_build/html
	@echo "the site is in docs/_build/html/index.html"

docs-serve: docs
	$(BIN)/python -m http.server --bind 127.0.0.1 --directory docs/_build/html 8000

system-packages:
	-@if command -v apt-get >/dev/null && [ "$$(id -u)" = 0 ]; then apt-get update -qq && \
	  DEBIAN_FRONTEND=noninteractive apt-get install -y -qq qemu-user qemu-system-arm chromium mesa-vulkan-drivers libvulkan1 libegl1 libgl1-mesa-dri >/dev/null; \
	  else echo "no apt-get, or not root: tests of viewers, videos and other processors may be skipped"; fi

setup: $(VENV)/.installed

$(VENV)/.installed: pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "uvms-mj needs Python 3.11 or newer; name one with make PYTHON=python3.12" >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --disable-pip-version-check --quiet uv # it installs in a tenth of pip's time
	@# what was fetched for another clone is not asked for again; an index may be known to pip alone; .[dev] is no pattern
	set -f; add="pip install --quiet --editable .[dev]"; uv="$(BIN)/uv $$add --python $(BIN)/python"; \
	  $$uv --offline 2>/dev/null || $$uv || $(BIN)/$$add
	touch $@

clean:
	rm -rf $(VENV) docs/_build .pytest_cache .ruff_cache .hypothesis .import_linter_cache
