# Everything a user or developer of mebo_grasp runs; `make help` lists it.

PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
DEMO_OUT ?= out/demo
# More arguments for pytest, e.g. make test PYTEST_ARGS="test/unit -x"
PYTEST_ARGS ?=
# Two tests at a time, each with one BLAS thread; `make test PYTEST_WORKERS=` runs them one after another.
PYTEST_WORKERS ?= -n 2 --dist loadfile
# A hanging test is stopped after this many seconds; no test measures itself against it.
HANG_SECONDS ?= 300

# What `make bench` measures; one BLAS thread each, so that "on one core" means it.
BENCHES_OF_SOLUTIONS := mebo_grasp.benchmarks.solutions mebo_grasp.nodes.bench_solution_set
BENCHES := mebo_grasp.benchmarks.hand mebo_grasp.benchmarks.optimizer \
	$(BENCHES_OF_SOLUTIONS) mebo_grasp.nodes.bench_nodes
bench bench-hand bench-solutions soak sweep-objects test test-quick: export OMP_NUM_THREADS = 1
bench bench-hand bench-solutions soak sweep-objects test test-quick: export OPENBLAS_NUM_THREADS = 1

.DEFAULT_GOAL := help
.PHONY: help setup icub-meshes demo test test-quick lint bench bench-hand bench-solutions soak \
	sweep-objects build-ros clean clean-all

help:  ## Show this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "  make %-16s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

setup:  ## Make or update .venv: requirements, typed interfaces, this package (PYTHON=python3.12 to choose)
	@$(PYTHON) tools/setup_environment.py --venv "$(VENV)"

icub-meshes:  ## Also install the iCub's meshes (optional, CC BY 4.0)
	@$(PYTHON) tools/setup_environment.py --venv "$(VENV)" --icub-meshes

demo: setup  ## Explore the built-in bottle with three real nodes, show the grasps (picture in out/demo)
	$(BIN)/mebo-grasp explore --object bottle --space position --budget 100 --seed 1 --out "$(DEMO_OUT)" --restart

test: setup  ## Run all tests, with real node processes
	$(BIN)/python -m pytest --timeout=$(HANG_SECONDS) $(PYTEST_WORKERS) $(PYTEST_ARGS)

test-quick: setup  ## Run the tests that start no nodes and take no ten seconds
	$(BIN)/python -m pytest --timeout=$(HANG_SECONDS) $(PYTEST_WORKERS) -m "not nodes and not slow" $(PYTEST_ARGS)

lint: setup  ## Check style and types of code, tests and tools
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy mebo_grasp msg_adapters test tools

bench: setup  ## Measure speed, memory and latency; prints the figures with their spread
	@for module in $(BENCHES); do echo "== $$module"; $(BIN)/python -m "$$module" || exit 1; echo; done

bench-solutions: setup  ## Of these, the solution set alone: 10,000 and 1,000,000 grasps, in the core and over ROS
	@for module in $(BENCHES_OF_SOLUTIONS); do echo "== $$module"; $(BIN)/python -m "$$module" || exit 1; echo; done

soak: setup  ## The fault tests at full length: 200 writers killed at random instants, 100 damaged files
	MEBO_GRASP_KILLS=200 MEBO_GRASP_DAMAGES=100 $(BIN)/python -m pytest --timeout=3600 test/faults $(PYTEST_ARGS)

bench-hand: setup  ## Measure the simulated hand alone, beside Simox's reference trials where they are at hand
	@$(BIN)/python -m mebo_grasp.benchmarks.hand

sweep-objects: setup  ## Try a thousand meshes of pybullet_data; goes on where out/object_sweep.jsonl ends
	@$(BIN)/python -m mebo_grasp.benchmarks.object_sweep

build-ros:  ## With an installed, sourced ROS 2: colcon build of both packages into install/
	@command -v colcon >/dev/null || { echo "colcon is missing: sudo apt install python3-colcon-common-extensions"; exit 1; }
	@test -n "$$ROS_DISTRO" || { echo "no ROS is sourced: . /opt/ros/jazzy/setup.bash"; exit 1; }
	colcon build --base-paths . mebo_grasp_interfaces
	@echo "built; now say: . install/setup.bash"

clean:  ## Remove what builds and tests leave behind; .venv stays
	rm -rf build install log out *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find mebo_grasp msg_adapters test tools -name __pycache__ -type d -prune -exec rm -rf {} +

clean-all: clean  ## Remove .venv too
	rm -rf "$(VENV)"
