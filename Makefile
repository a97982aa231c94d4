# make demo    learn the bundled object, predict light from its test photos, write runs/demo/report/index.html
# make check   style, types, import contract, shapes in docstrings, fast tests
# make test    the same with the slow tests: four to ten minutes
# make test-all  the same with the long ones (trainings, the documentation's build), as continuous integration runs it
# make style, make tests   the parts of these three, which run side by side; MARKS chooses tests
# make docs    the documentation, build/docs/index.html; a warning is an error
# make coverage  which lines and branches the tests run, build/coverage/index.html; MARKS="not long" for a part of them
# make fuzz    damaged and hostile files for every reader, for MINUTES (60); findings are left in build/fuzz
# make kills   kill -9 at MOMENTS (50) moments of the commands, full disks; the same bits afterwards
# make bench   timings of kernels and stages (benchmarks/SPEED.md), then every scene in DATA that has no record yet
#              (benchmarks/RESULTS.md)

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.installed
TOOLS := $(VENV)/.installed-dev
SPHINX := $(VENV)/.installed-docs
# Files of tests side by side, as many as there are cores, up to four. One thread each, and none that spins while it
# waits: two processes that do take five times as long as one. Byte code is kept: the tests start hundreds of programs.
PYTEST := PYTHONDONTWRITEBYTECODE= OMP_NUM_THREADS=1 OMP_WAIT_POLICY=passive \
	$(BIN)/pytest -q -n auto --maxprocesses 4 --dist loadfile --no-loadscope-reorder
DATA ?= data
MARKS ?=
MINUTES ?= 60
MOMENTS ?= 50

.PHONY: demo check test test-all style tests docs coverage fuzz kills bench

demo: $(READY)
	$(BIN)/lightprobe demo

check: $(TOOLS)
	@$(MAKE) --no-print-directory -j 2 style tests MARKS="not slow and not long and not cuda" || $(FAILED)

test: $(TOOLS)
	@$(MAKE) --no-print-directory -j 2 style tests MARKS="not long" || $(FAILED)

test-all: $(TOOLS)
	@$(MAKE) --no-print-directory -j 2 style tests || $(FAILED)

# What is wrong with the style is printed when it is found, and once more after the tests.
FAILED = { cat build/style-failed.txt 2>/dev/null; exit 1; }

style: $(TOOLS)
	@mkdir -p build && rm -f build/style-failed.txt
	@{ $(BIN)/ruff check && $(BIN)/ruff format --check && $(BIN)/mypy && $(BIN)/lint-imports \
	&& $(BIN)/python tools/check_shapes.py && $(BIN)/python tools/check_licences.py --bill build/sbom.json; \
	} > build/style.txt 2>&1 || mv build/style.txt build/style-failed.txt
	@cat build/style*.txt && test ! -e build/style-failed.txt

tests: $(TOOLS)
	@$(PYTEST) -m "$(MARKS)"

docs: $(SPHINX)
	@$(BIN)/python -m sphinx -q -E -n -W --keep-going docs build/docs
	@echo build/docs/index.html

coverage: $(TOOLS)
	@$(PYTEST) -m "$(MARKS)" --cov --cov-report=term --cov-report=html:build/coverage

fuzz: $(TOOLS)
	@OMP_NUM_THREADS=1 OMP_WAIT_POLICY=passive $(BIN)/python -m tests.fuzz --minutes $(MINUTES)

kills: $(TOOLS)
	@OMP_NUM_THREADS=1 NUMBA_NUM_THREADS=1 $(BIN)/python -m tests.kills --moments $(MOMENTS)

bench: $(TOOLS)
	@$(BIN)/pytest -q --benchmark-enable --benchmark-only tests
	@$(BIN)/python -m benchmarks speed
	@if test -d '$(DATA)'; then $(BIN)/python -m benchmarks run --data '$(DATA)'; \
	else echo 'SKIPPED the scenes: there is no folder $(DATA); run make bench DATA=FOLDER'; fi

$(READY): pyproject.toml constraints.txt
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet -c constraints.txt -e .
	touch $@

$(TOOLS): $(READY)
	$(BIN)/python -m pip install --quiet -c constraints.txt -e '.[dev]'
	touch $@

$(SPHINX): $(READY)
	$(BIN)/python -m pip install --quiet -c constraints.txt -e '.[docs]'
	touch $@
