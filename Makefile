# make demo    the whole suite at work, results in runs/demo; MACHINE=... names another machine,
#              VIEW=1 shows it in a browser meanwhile; REALTIME=1 runs it at the pace of a real
#              crane, with encoders at RATE=200, 100 or 50 Hz
# make view, make pictures, make tables   large packages that few commands need: the live view
#              (crane_viewer viewer), the crane drawn (crane_sim film, picture, view), CSV and Parquet
# make test    all tests
# make discrepancy-benchmark   how often `diagnose` is right about hidden effects, in runs/
# make observer-benchmark   positions without encoders, and sensors that lie, in runs/observer; hours
# make study   the report's experiment with 20 + 2 trajectories, results in runs/study
# make bench   measurements of speed
# make figures put what was measured (demo, study, discrepancy-benchmark, bench) into the manual
# make lint    style and types of the code, prose, links and spelling of the manual
# make docs    the manual as a site, runs/docs/html/index.html
# make setup   only what every target above does first: environment, packages, build
# make clean   remove what the set-up made (not runs/)
#
# PYTHON=... names the interpreter for the virtual environment, TESTS=... the tests to run.

SHELL := bash
TESTS ?= tests/integration tests/unit
# What promises a number beside the benchmarks proper.
BENCH := tests/benchmarks tests/integration/test_bringup.py tests/integration/test_cluster.py \
	tests/unit/crane_identification/test_estimators.py
export PYTHON
# Nothing started from here talks to other machines: env.sh sees to it where this is not set.
unexport ROS_AUTOMATIC_DISCOVERY_RANGE

in_env := source scripts/env.sh && source scripts/step.sh &&

.PHONY: help view pictures tables demo study discrepancy-benchmark observer-benchmark test bench figures lint docs setup clean

help:
	@sed -n '/^$$/q; s/^# //p' Makefile

setup:
	@scripts/setup.sh

view:
	@scripts/setup.sh view

pictures:
	@scripts/setup.sh pictures

tables:
	@scripts/setup.sh tables

demo: $(if $(VIEW),view,setup)
	@$(in_env) python scripts/demo/demo.py $(if $(SEED),--seed $(SEED)) \
		$(if $(MACHINE),--machine $(MACHINE)) $(if $(VIEW),--view) \
		$(if $(REALTIME),--realtime) $(if $(RATE),--rate $(RATE))

study: setup
	@$(in_env) ros2 run crane_benchmark study

discrepancy-benchmark: pictures
	@scripts/setup.sh benchmark
	@$(in_env) ros2 run crane_benchmark discrepancy

test:
	@scripts/setup.sh test tables pictures view benchmark
	@$(in_env) scripts/test.sh $(TESTS)

observer-benchmark: pictures
	@$(in_env) failed=0; \
	ros2 run crane_benchmark observer --out runs/observer/observer.json || failed=1; \
	ros2 run crane_benchmark loads --out runs/observer/loads.json || failed=1; \
	for machine in stock hard; do \
		ros2 run crane_benchmark sensors --on $$machine --cases 150 --hours 10 \
			--out runs/observer/sensors_$$machine.json \
			--picture runs/observer/smallest_faults_$$machine.png || failed=1; \
	done; \
	exit $$failed

bench:
	@scripts/setup.sh test tables pictures view benchmark
	@$(in_env) python -m pytest -s $(BENCH)

figures: setup
	@$(in_env) export PYTHONPATH="docs:$$PYTHONPATH"; \
	python -m from_code.parameter_files && python -m from_code.figures

lint:
	@scripts/setup.sh test tables pictures
	@$(in_env) step style "1 s" "ruff check --fix ." ruff check . && \
	step format "1 s" "ruff format ." ruff format --check . && \
	step prose "1 s" "the sentence or link that it names" python scripts/check_prose.py && \
	step spelling "5 s" "the word that it names, or the ignore list in pyproject.toml" codespell && \
	step types "10 s to 2 min" "the line that it names" mypy; finish

# A warning is an error.
docs:
	@scripts/setup.sh docs tables pictures
	@$(in_env) step manual "1 to 4 min" "mend the page that it names; or rm -r runs/docs" \
	python -m sphinx -W --keep-going -q -j auto -d runs/docs/doctrees docs runs/docs/html; finish

clean:
	rm -rf .venv build install log .pytest_cache .mypy_cache .ruff_cache .hypothesis
