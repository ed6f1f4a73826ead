# Everything runs in .venv, which any target builds if it is missing: `make table1` with the packages
# of the command fjh, all others with those of tests, checks and site as well.
PYTHON ?= python3
BIN := .venv/bin
STAMP := .venv/installed
COMMAND := .venv/command
KERNELS := kernels/_kernels.so
INSTALL := $(BIN)/python -m pip install --no-compile --constraint constraints.txt --editable
RUNS := build/numbers
# The run `lock` of `fjh paper report`.
LOCKED := --major 3,5,4 --size 0.015 --fail motor2:locked@3.25 --duration 6.5

.PHONY: venv lock table1 test test-all test-ci test-processors coverage test-sanitized fuzz wheel-test numbers robots dist check hooks docs tables bench pictures clean

venv: $(STAMP) $(KERNELS)

$(BIN)/python:
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install "pip>=25.1"  # supports dependency groups

$(COMMAND): pyproject.toml constraints.txt | $(BIN)/python
	$(INSTALL) ".[all]"
	touch $(COMMAND)

$(STAMP): pyproject.toml constraints.txt | $(BIN)/python
	$(INSTALL) ".[all]" --group test --group check --group docs
	touch $(COMMAND) $(STAMP)

# The installation compiles the kernels; this target is for changes to them.
$(KERNELS): kernels/build.py $(wildcard kernels/*.[ch]) | $(BIN)/python
	$(BIN)/python kernels/build.py

table1: $(COMMAND) $(KERNELS)
	$(BIN)/fjh table1

# Each file of tests runs in one process, on all cores. With two BLAS threads each, two processes
# need 1.5 times as long.
PYTEST := $(BIN)/python -m pytest --numprocesses auto --dist loadfile --durations 20 --durations-min 0.4
test test-all test-ci coverage: export OPENBLAS_NUM_THREADS = 1
# Without bytecode, every process rewrites the assertions of all test files: 4 s each.
unexport PYTHONDONTWRITEBYTECODE

# The short tests: laws, physics, command line; 60 s on two idle cores.
test: venv
	$(PYTEST) -m "not long"

# All tests, with every study at full length.
test-all: venv
	$(PYTEST)

# All tests without those marked night: what CI runs.
test-ci: venv
	$(PYTEST) -m "not night"

# The short tests with the numerics of other processors: each OpenBLAS kernel that this processor
# supports, numpy without wide instructions, two BLAS threads, another order. Each night.
test-processors: venv
	$(BIN)/python tools/processors.py

# Report of the Python lines that the short tests run, in build/coverage; there is no bound.
coverage: venv
	PROPERTIES=local $(PYTEST) -m "not long" --cov --cov-report=term:skip-covered --cov-report=html:build/coverage

# The kernels compiled with the address and undefined-behaviour sanitizers: an access beyond an array
# ends the tests with an uncaptured message. Each night.
test-sanitized: venv
	$(BIN)/python kernels/build.py --sanitized
	FJH_KERNELS=build/sanitized/_kernels.so ASAN_OPTIONS=detect_leaks=0 \
	    LD_PRELOAD="$$(cc -print-file-name=libasan.so) $$(cc -print-file-name=libubsan.so)" \
	    PROPERTIES=local $(BIN)/python -m pytest -p no:xdist --capture sys -m "not long" \
	    tests/kernels tests/prioritized tests/sim tests/ftc tests/fjh/rig/test_hexapod.py

# The kernels on inputs of libFuzzer, with sanitizers, for SECONDS; needs clang. Failing inputs are
# saved in build/fuzz; `build/fuzz/kernels FILE` repeats one. Each night.
SECONDS := 300
fuzz:
	mkdir -p build/fuzz/corpus
	clang -g -O1 -std=c99 -fsanitize=fuzzer,address,undefined -fno-sanitize-recover=undefined \
	    -DKERNELS_DIGEST='"fuzz"' -Ikernels tools/fuzz_kernels.c kernels/*.c -lm -o build/fuzz/kernels
	build/fuzz/kernels -max_len=4096 -len_control=0 -max_total_time=$(SECONDS) \
	    -print_final_stats=1 -artifact_prefix=build/fuzz/ build/fuzz/corpus

# The wheel in an empty environment: base, extras sim and all, the README's examples, types.
wheel-test:
	$(PYTHON) tools/wheel.py

# Every number of the pages, from this checkout: all studies, public robots and times, copied to
# docs/data. Two hours on two idle cores; after an interruption the same command continues. A check
# that fails stops nothing: docs/data/origin.json names it.
numbers: venv
	-$(BIN)/fjh paper report --out $(RUNS)
	$(MAKE) robots
	-$(MAKE) bench
	$(BIN)/python -m tools.numbers $(RUNS)
	$(MAKE) tables

# Robots of registry packages, from their file to a run, and three of them with failures, in
# build/robots; results of the same code are not computed again.
robots: venv
	$(BIN)/python -m tools.public_robots

# The files of a release, in dist: the sources, and the wheel built from them.
dist: venv
	rm -rf dist
	$(BIN)/python -m build --outdir dist

# constraints.txt from pyproject.toml; versions that still fit are retained.
LOCK := $(BIN)/uv pip compile --quiet --universal --python-version 3.11 --no-annotate --no-header --no-emit-index-url
lock: venv
	$(LOCK) pyproject.toml --extra all --group test --group check --group docs --group wheel --output-file constraints.txt
	sed -i '1i # Exact versions that CI runs, made by `make lock`; passed to pip as --constraint.' constraints.txt
	$(LOCK) pyproject.toml --extra sim --group bench --output-file benchmarks/constraints.txt
	sed -i '1i # Exact versions of `make bench`, made by `make lock`.' benchmarks/constraints.txt

# Format, lint, imports between the rooms, tables of the pages, workflows, types.
check: venv
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/lint-imports --no-cache --no-logo
	$(BIN)/python docs/_extensions/tables.py --check
	$(BIN)/check-jsonschema --builtin-schema vendor.github-workflows .github/workflows/*.yml
	$(BIN)/zizmor --offline --no-progress --quiet .github/workflows
	$(BIN)/pyright

# `make check` before every commit, by pre-commit.
hooks: venv
	$(BIN)/pre-commit install

# The site, in build/site; a broken link or reference is an error. Needs no network.
# `make docs SPHINX="-D plot_gallery=0"` runs no example.
docs: venv
	$(BIN)/python -m sphinx -W --keep-going --quiet $(SPHINX) -d build/doctrees docs build/site

# Update the tables of the pages from docs/data, for readers on GitHub; the site updates its own.
tables: venv
	$(BIN)/python docs/_extensions/tables.py

# Times relative to other solvers, in a minute: a table and a figure in build/bench; an error if a
# reproducible ratio exceeds three times its bound. Run nothing else meanwhile.
BENCH := build/bench/venv/bin/python
bench: build/bench/installed
	$(BENCH) -m pytest benchmarks --quiet -p no:cacheprovider --benchmark-timer time.process_time \
	    --benchmark-quiet --benchmark-json build/bench/run.json
	$(BENCH) -m benchmarks.table build/bench/run.json build/bench --check

build/bench/installed: pyproject.toml benchmarks/constraints.txt
	$(PYTHON) -m venv build/bench/venv
	$(BENCH) -m pip install "pip>=25.1"
	$(BENCH) -m pip install --no-compile --constraint benchmarks/constraints.txt --editable ".[sim]" --group bench
	touch build/bench/installed

# The pictures in docs/pictures without the drawings machine, figure2, figure3 and rooms, after `make
# numbers`: figures of studies, recordings in the viewer, and pages in Chromium, which must be
# installed.
pictures: venv
	for study in table1 figures jacobian uncorrected force goals limits recover events sweep atlas; do \
	  for file in $(RUNS)/$$study/*.png; do \
	    [ ! -e docs/pictures/$$(basename $$file) ] || cp $$file docs/pictures/; done; done
	cp build/bench/bench.png docs/pictures/
	$(BIN)/fjh survey models/arm.xml --axes base --out $(RUNS)/surveyed/arm
	cp $(RUNS)/surveyed/arm/survey.png docs/pictures/
	$(BIN)/fjh review $(RUNS)/table1 --out $(RUNS)/review.rrd
	$(BIN)/fjh render $(RUNS)/review.rrd --size 1600x1200 --out docs/pictures/review.png
	$(BIN)/fjh render $(RUNS)/recover/locked.rrd --time 9.3 --out docs/pictures/failure.png
	$(BIN)/fjh track models/arm.xml $(LOCKED) --diagnosis off --out $(RUNS)/undiagnosed
	$(BIN)/fjh render $(RUNS)/lock/track.rrd --out docs/pictures/run.png
	$(BIN)/fjh animate $(RUNS)/undiagnosed/track.npz $(RUNS)/lock/track.npz --out docs/pictures/animation.gif
	$(BIN)/python -m tools.live_picture docs/pictures/live.png

clean:
	rm -rf .venv results build dist *.egg-info
