# Needs Python 3.11 or newer and make; everything else is installed into .venv.
#
#   make demo    set up, then solve a job of the literature on a service of its own
#   make test    set up, then everything that CI checks
#   make check   lint, types, arrows between the packages, the documentation without warnings
#   make docs    the documentation as pages, in build/docs
#   make serve   run the service on http://127.0.0.1:8000
#   make page    build the page at / anew, for which Node.js is needed (what it builds is in the repository)
#   make page-pictures   the pictures of docs/page.md, for which Chromium is needed
#   make bench   the benchmark tables
#   make bench-ga   the tables of the genetic algorithm (about 20 minutes), and its figures
#   make papers  the papers reproduced: their tables and figures in docs/papers (about 15 minutes)
#   make soak    a service with production values to which a thousand faults happen (about half an hour), then
#                missions from every side of the Earth (some minutes)
#   make bench-peers   the same problems by other libraries, each installed into .venv-peers (about 10 minutes)

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt

.PHONY: setup demo test check check-code check-types check-docs docs serve page page-pictures bench bench-ga bench-peers papers soak clean

setup: $(VENV)/.installed

$(VENV)/.installed: pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
	  echo "ondelette needs Python 3.11 or newer, and '$(PYTHON)' is not." >&2; \
	  echo "Name another interpreter: make $(MAKECMDGOALS) PYTHON=python3.12" >&2; exit 1; }
	@echo "setting up $(VENV) (once, about a minute)"
	@$(BIN)/python -m pip --version >/dev/null 2>&1 || $(PYTHON) -m venv $(VENV)
	@$(PIP) --editable .
	@touch $@

$(VENV)/.installed-dev: $(VENV)/.installed
	@echo "adding the tools of the tests"
	@$(PIP) --editable '.[dev]'
	@touch $@

demo: setup
	@$(BIN)/ondelette demo

serve: setup
	@$(BIN)/ondelette serve

page:
	npm ci --prefix page --no-audit --no-fund
	npm run --prefix page check
	npm run --prefix page build

page-pictures: $(VENV)/.installed-dev
	@$(BIN)/python page/pictures.py

bench: setup
	@$(BIN)/ondelette bench

bench-ga: $(VENV)/.installed-dev
	@$(BIN)/python benchmarks/genetic.py
	@$(BIN)/python benchmarks/genetic_figures.py

papers: $(VENV)/.installed-dev
	@$(BIN)/python benchmarks/papers.py

PEERS := $(patsubst benchmarks/peers/requirements-%.txt,%,$(wildcard benchmarks/peers/requirements-*.txt))

# The lists of requirements are complete, so that nothing else is resolved. What cannot be installed stays
# without its environment, and the table says so.
.venv-peers/%/.installed: benchmarks/peers/requirements-%.txt
	@echo "setting up .venv-peers/$*"
	@{ $(PYTHON) -m venv .venv-peers/$* && \
	   .venv-peers/$*/bin/python -m pip install --quiet --disable-pip-version-check --no-deps -r $< && \
	   touch $@; } || { echo "$* could not be installed" >&2; rm -rf .venv-peers/$*; }

bench-peers: setup $(PEERS:%=.venv-peers/%/.installed)
	@$(BIN)/python benchmarks/peers/run.py

# Two at a time: types and documentation take half a minute each, and one core.
check: $(VENV)/.installed-dev
	@$(MAKE) --no-print-directory --jobs 2 --output-sync=target check-types check-docs check-code

check-code:
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports --no-logo --no-cache

check-types:
	$(BIN)/mypy

check-docs:
	$(DOCS) --quiet

DOCS = $(BIN)/sphinx-build --fail-on-warning --keep-going --fresh-env --doctree-dir build/doctrees docs build/docs

docs: $(VENV)/.installed-dev
	@$(DOCS)
	@echo "open build/docs/index.html"

# Files side by side, in their order: those that start services, and wait for them, come first.
test: check
	$(BIN)/pytest --numprocesses 2 --dist loadfile --no-loadscope-reorder

soak: $(VENV)/.installed-dev
	$(BIN)/python -m tests.faults.soak
	$(BIN)/python benchmarks/soak/piecewise.py

clean:
	rm -rf $(VENV) build dist *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
