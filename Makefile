# Everything runs in .venv, which any target builds when it is missing: `make table1` with what the
# command fjh needs, all others with what tests, checks and site need, too.
PYTHON ?= python3
BIN := .venv/bin
STAMP := .venv/installed
COMMAND := .venv/command
KERNELS := kernels/_kernels.so
INSTALL := $(BIN)/python -m pip install --no-compile --constraint constraints.txt --editable
RUNS := results/report
# Two flights of the arm around a circle of 30 mm whose shoulder locks after 3.25 s.
LOCKED := --major 3,5,4 --size 0.015 --turn 4 --fail motor2:locked@3.25 --duration 6.5

.PHONY: venv lock table1 test test-all test-ci test-processors coverage test-sanitized fuzz wheel-test robots dist check hooks docs tables bench pictures clean

venv: $(STAMP) $(KERNELS)

$(BIN)/python:
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install "pip>=25.1"  # which knows dependency groups

$(COMMAND): pyproject.toml constraints.txt | $(BIN)/python
	$(INSTALL) ".[all]"
	touch $(COMMAND)

$(STAMP): pyproject.toml constraints.txt | $(BIN)/python
	$(INSTALL) ".[all]" --group test --group check --group docs
	touch $(COMMAND) $(STAMP)

# The installation builds them; this is for who changes them.
$(KERNELS): kernels/build.py $(wildcard kernels/*.[ch]) | $(BIN)/python
	$(BIN)/python kernels/build.py

table1: $(COMMAND) $(KERNELS)
	$(BIN)/fjh table1

# On all cores, a file of tests in one process. Two processes whose BLAS has two threads each take
# half as long again.
PYTEST := $(BIN)/python -m pytest --numprocesses auto --dist loadfile --durations 20 --durations-min 0.4
test test-all test-ci coverage: export OPENBLAS_NUM_THREADS = 1
# Without bytecode every process rewrites the assertions of all test files anew, 4 s each.
unexport PYTHONDONTWRITEBYTECODE

# Every law, the physics, the command line: 60 s on two idle cores.
test: venv
	$(PYTEST) -m "not long"

# The same, what takes long, and every study at full length.
test-all: venv
	$(PYTEST)

# All but what waits for the night: what CI runs.
test-ci: venv
	$(PYTEST) -m "not night"

# The short tests as other processors compute them: with each kernel of OpenBLAS that this one can
# run, without wide instructions in numpy, with two BLAS threads, in another order. Each night.
test-processors: venv
	$(BIN)/python tools/processors.py

# Which lines of Python the short tests run: a report in build/coverage, no bound.
coverage: venv
	PROPERTIES=local $(PYTEST) -m "not long" --cov --cov-report=term:skip-covered --cov-report=html:build/coverage

# The kernels, compiled with the sanitizers of addresses and undefined behaviour: a number read or
# written beyond an array ends the tests, and what they say of it is not captured. Each night.
test-sanitized: venv
	$(BIN)/python kernels/build.py --sanitized
	FJH_KERNELS=build/sanitized/_kernels.so ASAN_OPTIONS=detect_leaks=0 \
	    LD_PRELOAD="$$(cc -print-file-name=libasan.so) $$(cc -print-file-name=libubsan.so)" \
	    PROPERTIES=local $(BIN)/python -m pytest -p no:xdist --capture sys -m "not long" \
	    tests/kernels tests/prioritized tests/sim tests/ftc tests/fjh/rig/test_hexapod.py

# The kernels on what libFuzzer makes up, under the sanitizers, for so many seconds: needs clang. What
# fails is kept in build/fuzz; `build/fuzz/kernels FILE` repeats it. Each night.
SECONDS := 300
fuzz:
	mkdir -p build/fuzz/corpus
	clang -g -O1 -std=c99 -fsanitize=fuzzer,address,undefined -fno-sanitize-recover=undefined \
	    -DKERNELS_DIGEST='"fuzz"' -Ikernels tools/fuzz_kernels.c kernels/*.c -lm -o build/fuzz/kernels
	build/fuzz/kernels -max_len=4096 -len_control=0 -max_total_time=$(SECONDS) \
	    -print_final_stats=1 -artifact_prefix=build/fuzz/ build/fuzz/corpus

# The wheel in an empty environment: base, sim and testbed, the README's examples, types.
wheel-test:
	$(PYTHON) tools/wheel.py

# docs/data/robots.csv and docs/refused.md: robots of registry packages, from their file to a run; an
# hour the first time. What has a result in build/robots/trials is not run again.
robots: venv
	$(BIN)/python -m tools.public_robots

# What a release consists of, in dist: the sources, and the wheel built from them.
dist: venv
	rm -rf dist
	$(BIN)/python -m build --outdir dist

# constraints.txt anew from pyproject.toml; versions that still fit stay as they are.
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

# The tables of the pages anew from docs/data, for who reads them on GitHub; the site does so itself.
tables: venv
	$(BIN)/python docs/_extensions/tables.py

# Times beside those of other solvers, a minute: a table and a figure in build/bench, and an error if
# a ratio that hardly scatters exceeds three times its bound. Nothing else should run meanwhile.
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

# The pictures in docs/pictures without the drawings machine, figure2, figure3 and rooms: figures of
# all studies, recordings in the viewer, and pages in Chromium, which must be installed. Estimated
# two hours the first time, 40 minutes of them `recover`; results that exist are not computed again.
pictures: venv
	$(BIN)/fjh paper report --out $(RUNS)
	$(BIN)/fjh paper atlas --resume --out $(RUNS)/flown
	for file in $(RUNS)/*/*.png; do \
	  [ ! -e docs/pictures/$$(basename $$file) ] || cp $$file docs/pictures/; done
	$(MAKE) bench
	cp build/bench/bench.png docs/pictures/
	$(BIN)/fjh survey models/arm.xml --axes base --out $(RUNS)/surveyed/arm
	cp $(RUNS)/surveyed/arm/survey.png docs/pictures/
	$(BIN)/fjh review $(RUNS)/table1 --out $(RUNS)/review.rrd
	$(BIN)/fjh render $(RUNS)/review.rrd --size 1600x1200 --out docs/pictures/review.png
	$(BIN)/fjh render $(RUNS)/recover/locked.rrd --time 9.3 --out docs/pictures/failure.png
	$(BIN)/fjh track models/arm.xml $(LOCKED) --diagnosis off --out $(RUNS)/lock/without_diagnosis
	$(BIN)/fjh track models/arm.xml $(LOCKED) --out $(RUNS)/lock/with_diagnosis
	$(BIN)/fjh render $(RUNS)/lock/with_diagnosis/track.rrd --out docs/pictures/run.png
	$(BIN)/fjh animate $(RUNS)/lock/without_diagnosis/track.npz \
	    $(RUNS)/lock/with_diagnosis/track.npz --out docs/pictures/animation.gif
	$(BIN)/python -m tools.live_picture docs/pictures/live.png

clean:
	rm -rf .venv results build dist *.egg-info
