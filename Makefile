# make demo    run the suite on the simulated crane, results in runs/demo; MACHINE=... names another
#              machine; VIEW=1 shows it in a browser; REALTIME=1 runs at the pace of a real crane,
#              with encoders at RATE=200, 100 or 50 Hz
# make view, make pictures, make tables   install optional packages for the live view (crane_viewer
#              viewer), pictures of the crane (crane_sim film, picture, view), CSV and Parquet
# make test    run all tests
# make bench   measure speed
# make study   repeat the paper's experiment with 20 + 2 trajectories, results in runs/study
# make discrepancy-benchmark   count how often `diagnose` is right, results in runs/; hours
# make observer-benchmark   score position estimates and sensor faults, in runs/observer; hours
# make figures copy the measurements (demo, study, discrepancy-benchmark, bench) into the manual
# make lint    check style and types of the code, prose, links and spelling of the manual
# make docs    build the manual as a site, runs/docs/html/index.html
# make setup   set up environment, packages and build, as every target above does first
# make clean   remove the set-up, but not runs/
#
# PYTHON=... names the interpreter for the virtual environment, TESTS=... the tests to run.

SHELL := bash
TESTS ?= tests/integration tests/unit
# Tests that measure, next to the benchmarks.
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
	@$(in_env) step manual "1 to 4 min" "the page that it names; or rm -r runs/docs" \
	python -m sphinx -W --keep-going -q -j auto -d runs/docs/doctrees docs runs/docs/html; finish

clean:
	rm -rf .venv build install log .pytest_cache .mypy_cache .ruff_cache .hypothesis
