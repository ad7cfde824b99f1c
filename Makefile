# deltac needs GNU make and Python 3.11 or newer; everything else is installed into .venv.

PYTHON ?= python3
VENV := .venv
PY := $(VENV)/bin/python
PYTEST := $(PY) -m pytest
# A process for each core, from two to eight, since each collects all tests by itself, which takes 7 s. Each takes its
# share of the files in their order, and whoever has finished takes over from the others.
PROCESSES ?= $(shell n=$$(getconf _NPROCESSORS_ONLN 2>/dev/null || echo 2); \
	if [ "$$n" -gt 8 ]; then echo 8; elif [ "$$n" -gt 2 ]; then echo "$$n"; else echo 2; fi)
SPREAD = -n $(PROCESSES) --dist worksteal
ARGS ?=

# One stamp per set of requirements: reinstalled when pyproject.toml changes, or after `make clean`.
CORE := $(VENV)/.deltac-core
TEST := $(VENV)/.deltac-test
DEV := $(VENV)/.deltac-dev
BENCH := $(VENV)/.deltac-bench

.DEFAULT_GOAL := help
.NOTPARALLEL:
.SUFFIXES:
.PHONY: help demo test test-long test-casadi test-slow lint types schema layers check bench bench-verdict bench-foreign bench-judge bench-repair \
	bench-blackbox bench-correction bench-explain fuzz torture docs site site-quick web wheel check-web clean

help:  ## list the targets
	@echo "make TARGET [PYTHON=python3.12] [ARGS='options of pytest, the demo, the benchmarks']"
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  %-18s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

demo: $(CORE)  ## reproduce the thesis's study: ten figures, one table
	$(PY) benchmarks/thesis/run.py $(ARGS)

test: $(TEST)  ## the test suite, without the long and the slow tests
	$(PYTEST) $(SPREAD) -m "not slow and not long" $(ARGS)

test-long: $(TEST)  ## the long tests: whole audits and runs, one case after another
	$(PYTEST) $(SPREAD) -m "long and not slow" $(ARGS)

test-casadi: $(TEST)  ## the numerical tests again, on CasADi's own evaluator
	DELTAC_EVALUATOR=casadi $(PYTEST) $(SPREAD) -m "not slow and not heyoka" \
		tests/kernels tests/dynamics tests/energy $(ARGS)

test-slow: $(TEST)  ## the slow tests; those on random examples with ten times as many
	HYPOTHESIS_PROFILE=thorough $(PYTEST) $(SPREAD) -m "slow or random_examples" $(ARGS)

lint: $(DEV)  ## style: ruff's rules and format
	$(PY) -m ruff check
	$(PY) -m ruff format --check

types: $(DEV)  ## types: mypy, strict for the package, and the tests
	$(PY) -m mypy

schema: $(TEST)  ## write the JSON Schema of results anew, after a key has changed
	$(PY) -m website.json_schema

layers: $(DEV)  ## the direction of imports
	$(VENV)/bin/lint-imports

NPM := npm --prefix web --silent
web/node_modules: web/package.json web/package-lock.json
	$(NPM) ci --no-audit --no-fund
	@touch $@

web: web/node_modules  ## bundle the page's script into the package (needs node)
	$(NPM) run build

check-web: web/node_modules  ## the page's types, and that the committed bundle is a fresh build (needs node)
	$(NPM) run check

check: lint types layers site-quick test-casadi test test-long  ## all of the checks, as in continuous integration

wheel: $(DEV)  ## sdist and wheel into dist/, and the wheel tried in an empty environment
	PYTHON=$(abspath $(PY)) .ci/wheel

bench-explain: $(TEST)  ## how often a log's residual is explained rightly: planted faults
	$(PY) benchmarks/explain.py $(ARGS)

bench: $(BENCH)  ## the benchmarks, beside other simulators
	$(PY) benchmarks/run.py $(ARGS)

bench-verdict: $(TEST)  ## right and wrong equations, judged blind: the false verdicts
	$(PY) benchmarks/verdict.py $(ARGS)

bench-foreign: $(BENCH)  ## logs of other simulators and habits, judged blind: false alarms and misses
	$(PY) benchmarks/foreign/bench.py $(ARGS)

bench-judge: $(BENCH)  ## integrator, equations and log told apart: logs with true joules, beside an oracle
	$(PY) benchmarks/judge/bench.py $(ARGS)

bench-correction: $(TEST)  ## what restoring the energy buys, against exact motions
	$(PY) benchmarks/correction.py $(ARGS)

bench-blackbox: $(TEST)  ## what is told of mistakes in code that cannot be read: is it so?
	$(PY) benchmarks/blackbox.py $(ARGS)

bench-repair-wild: $(TEST)  ## the same for programs as people write them
	$(PY) benchmarks/wild.py $(ARGS)

bench-repair: $(TEST)  ## mistakes put into equations of motion: how many are detected, and repaired
	$(PY) benchmarks/repair.py $(ARGS)

SECONDS ?= 60
fuzz: $(TEST)  ## driven mechanisms against Newton and Euler; break our own parsers: make fuzz SECONDS=600
	$(PY) -m tests.fuzz.driven $(SECONDS)
	$(PY) -m tests.fuzz $(SECONDS) $(ARGS)

torture: $(TEST)  ## kill -9, full disks, read-only folders, many processes: nothing half-written, nothing lost
	$(PYTEST) -m "slow or not slow" tests/test_torture.py tests/fleets/test_fleet_torture.py $(ARGS)

bench-fleets: $(TEST)  ## what sweeps and audits of many logs cost beside the bare calls
	$(PY) benchmarks/fleets.py $(ARGS)

docs: $(TEST)  ## run the examples in documents and docstrings, follow the links (part of test and test-long)
	$(PYTEST) tests/test_docs.py $(ARGS)

site: $(DEV)  ## the documentation site, into site/: strictly, without the network; opens from disk
	NO_MKDOCS_2_WARNING=1 $(PY) -m mkdocs build $(ARGS)
	@echo "open site/index.html"

site-quick: $(DEV)  ## the same without the pictures of the gallery: are all pages and links in order?
	GALLERY=off $(MAKE) --no-print-directory site

clean:  ## remove caches and build products, and install afresh next time
	rm -rf build dist site .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis
	find . -path ./$(VENV) -prune -o -name __pycache__ -type d -prune -exec rm -rf {} +
	rm -f $(CORE) $(TEST) $(DEV) $(BENCH)

# --- the virtual environment ---------------------------------------------------------------------

# $(call require_python,INTERPRETER): stop with a remedy unless it is recent enough.
define require_python
@$(1) -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || { \
	echo "deltac needs Python 3.11 or newer, but $(1) is: $$($(1) --version 2>&1 || true)"; \
	echo "$(2)"; exit 1; } >&2
endef

# $(call install,REQUIREMENT,STAMPS): editable install; the stamps are made only when it succeeds.
# uv takes a third of pip's time. Of pip's configuration it is given the index and the certificates. Where it
# cannot be had, or does not reach what pip reaches, pip installs, and says what is wrong where something is.
# --no-compile: Python compiles what is imported, which is a fraction of what is installed.
PIP_OPTIONS := --quiet --disable-pip-version-check --no-input
define install
$(call require_python,$(PY),Remove $(VENV) and run make again with a newer one: make PYTHON=python3.12 ...)
@echo "setting up $(VENV) (half a minute, once)"
@rm -f $@
@$(PY) -m pip --version >/dev/null 2>&1 || $(PY) -m ensurepip >/dev/null || { \
	echo "$(VENV) has no pip, and it could not be added: remove $(VENV) and run make again" >&2; exit 1; }
@index=$${PIP_INDEX_URL:-$$($(PY) -m pip config get global.index-url 2>/dev/null)}; \
	{ $(PY) -m pip install $(PIP_OPTIONS) uv && \
	env UV_HTTP_TIMEOUT=180 $${index:+UV_DEFAULT_INDEX="$$index"} $${PIP_CERT:+SSL_CERT_FILE="$$PIP_CERT"} \
		$(PY) -m uv pip install --quiet --python $(PY) --editable "$(1)"; \
	} 2>/dev/null || $(PY) -m pip install $(PIP_OPTIONS) --no-compile --editable "$(1)"
@touch $(2)
endef

$(PY):
	$(call require_python,$(PYTHON),Name another interpreter: make PYTHON=python3.12 ...)
	@test -e $(VENV) && kept=yes; $(PYTHON) -m venv $(VENV) || { \
		test "$$kept" || rm -rf $(VENV); \
		echo "could not make $(VENV): remove it if it is there; on Debian and Ubuntu, apt install python3-venv" >&2; exit 1; }

# A larger set includes the smaller ones.
$(CORE): pyproject.toml | $(PY)
	$(call install,.[figures],$(CORE))

$(TEST): pyproject.toml | $(PY)
	$(call install,.[test],$(CORE) $(TEST))

$(DEV): pyproject.toml | $(PY)
	$(call install,.[dev],$(CORE) $(TEST) $(DEV))

# The benchmarks' set stands beside the tests': it brings other programs, some of them large.
$(BENCH): pyproject.toml | $(PY)
	$(call install,.[bench],$(CORE) $(BENCH))
