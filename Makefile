# Everything runs in .venv, which `setup` fills from the lock. Variables:
#   PYTHON=python3.12   the interpreter that .venv is made with
#   WORKERS=2           processes that run the tests
#   SUITE=, REPORT=     what `make bench` runs, and the folder it writes (default:
#                       reports/<suite>/<time>)
#   BENCHMARKS=--quick  a small version of every benchmark
#   MUTATION=           which mutants: "--area decide --mutants 20 --seed 2"
#   PYTEST_ARGS=, V=1   more arguments for pytest; show every command

PYTHON  ?= python3
WORKERS ?= 2
SUITE   ?= suites/paper.yaml
REPORT  ?=

BIN  := .venv/bin
LOCK := requirements/dev.txt
MUTMUT := requirements/mutation.txt
PIP  := $(BIN)/python -m pip --disable-pip-version-check --no-input

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
$(V).SILENT:

.PHONY: help setup bench test test-slow lint types imports check mutation benchmarks schemas lock docs clean distclean

help: ## show this list
	awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "  make %-12s %s\n", $$1, $$2}' Makefile

setup: .venv/.installed ## make .venv and install the locked packages and eha-bench into it

bench: setup ## run the paper's suite on the simulator; the last line is the report's path
	$(BIN)/eha-bench run $(SUITE) $(if $(REPORT),--out $(REPORT))

test: setup ## run the fast tests
	$(BIN)/python -m pytest -q -n $(WORKERS) --dist worksteal $(PYTEST_ARGS)

test-slow: setup ## run the slow tests
	$(BIN)/python -m pytest -q -n $(WORKERS) --dist worksteal -m slow $(PYTEST_ARGS)

check: lint types imports ## check style, types and import contracts

lint: setup
	$(BIN)/ruff check --quiet
	$(BIN)/ruff format --check --quiet
	echo "style: clean"

types: setup
	$(BIN)/mypy

imports: setup
	$(BIN)/lint-imports --no-cache --no-logo

# Not a part of CI: minutes of one processor, and each survivor is to be judged by a person.
mutation: setup ## change the code in small ways, and show which changes no test sees
	$(BIN)/uv pip install --quiet --python $(BIN)/python --require-hashes --requirement $(MUTMUT)
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python tests/mutation.py $(MUTATION)

benchmarks: setup ## print every benchmark's figures and targets in one table
	$(BIN)/python -m benchmarks $(BENCHMARKS)

schemas: setup ## write anew the JSON Schemas that editors complete YAML files from
	for kind in $$($(BIN)/python -c "from eha_bench.core import plugins; print(*plugins.names('file_kinds'))"); do \
	  $(BIN)/eha-bench schema $$kind > docs/schemas/.part && mv docs/schemas/.part docs/schemas/$$kind.json || exit 1; \
	done

COMPILE = $(BIN)/uv pip compile --quiet --universal --python-version 3.11 \
	--fork-strategy fewest --generate-hashes --no-emit-index-url \
	--custom-compile-command "make lock"

# The environment's own index settings must not leak into the lock; what is
# locked already stays, unless UPGRADE=--upgrade says otherwise.
lock: $(BIN)/python ## compile the lock files anew (UPGRADE=--upgrade takes newer versions)
	test -x $(BIN)/uv || $(PIP) install --quiet uv
	$(COMPILE) pyproject.toml $(UPGRADE) --all-extras --output-file $(LOCK)
	$(COMPILE) pyproject.toml --extra can --constraints $(LOCK) --no-annotate \
	  --output-file requirements/lock.txt
	echo mutmut | $(COMPILE) - --constraints $(LOCK) --no-annotate --output-file $(MUTMUT)

# Reports and figures are made by the product, so they show what it does today.
docs: setup ## build the documentation into build/site, links checked
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python docs/tools/gallery.py
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet
	$(BIN)/python docs/tools/check_site.py build/site
	echo build/site/index.html

clean: ## remove caches and built files
	rm -rf build dist docs/gallery docs/figures .mypy_cache .ruff_cache .pytest_cache .import_linter_cache .hypothesis
	find src tests benchmarks fixtures -name __pycache__ -type d -prune -exec rm -rf {} + 2>/dev/null || true

distclean: clean ## remove .venv too
	rm -rf .venv

# --- the environment ---------------------------------------------------------

$(BIN)/python:
	command -v $(PYTHON) >/dev/null || { \
	  echo "There is no $(PYTHON) here: install Python 3.11 or newer, or name one, e.g. make PYTHON=python3.12." >&2; exit 1; }
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
	  echo "eha-bench needs Python 3.11 or newer, but $(PYTHON) is $$($(PYTHON) -V 2>&1 | cut -d' ' -f2): install one, or name it, e.g. make PYTHON=python3.12." >&2; exit 1; }
	$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || { \
	  echo "$(PYTHON) cannot make virtual environments: install its venv package (Debian and Ubuntu: apt install python3-venv), or name another Python, e.g. make PYTHON=python3.12." >&2; exit 1; }
	echo "Making .venv with $$($(PYTHON) -V)"
	$(PYTHON) -m venv --clear .venv

# Two stamps, so that a new entry point does not install the lock again. uv installs in half of
# pip's time; where it does not get at the packages (an index that only pip is told of), pip does.
.venv/.locked: $(LOCK) | $(BIN)/python
	echo "Installing the packages of $(LOCK) (a minute or two)"
	awk '/^uv==/ { own = 1 } own { print } own && !/\\$$/ { exit }' $(LOCK) > .venv/uv.txt
	$(PIP) install --quiet --require-hashes --requirement .venv/uv.txt
	$(BIN)/uv pip install --quiet --python $(BIN)/python --compile-bytecode --require-hashes \
	  --requirement $(LOCK) || $(PIP) install --quiet --require-hashes --requirement $(LOCK)
	touch $@

.venv/.installed: pyproject.toml .venv/.locked
	$(PIP) install --quiet --no-deps --no-build-isolation --editable .
	$(PIP) check >/dev/null || { $(PIP) check; \
	  echo "The lock does not fit pyproject.toml: run make lock." >&2; exit 1; }
	# bytecode, as any installation has it: where Python may not write it, every start compiles all
	$(BIN)/python -m compileall -q src
	touch $@
