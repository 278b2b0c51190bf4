# Daily work. `make` alone lists the targets.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
ROS := ros
EXTRAS := fast,completion,modbus,serial,nidaqmx,matlab73,tdms,cluster,dashboard,test,colcon

help:  ## list the targets
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed 's/:.*## /\t/' | expand -t 24

$(VENV)/installed: setup.py
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' \
	  || { echo '$(PYTHON): Python 3.10 or newer is needed (try: make PYTHON=python3.12)'; exit 2; }
	@$(PYTHON) -m venv $(VENV) \
	  || { echo '$(PYTHON) -m venv failed: install the venv module (apt install python3-venv)'; exit 2; }
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --upgrade 'setuptools<80' wheel
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[$(ROS),$(EXTRAS)]'
	$(BIN)/hunt compile
	@touch $@

install: $(VENV)/installed  ## make .venv with the package, real rclpy, compiled kernels, test tools

wheel: $(VENV)/installed  ## a wheel in build/ with the machine code: who installs it compiles nothing
	$(BIN)/hunt compile
	$(BIN)/python -m pip wheel --quiet --disable-pip-version-check --no-deps --wheel-dir build .

demo: $(VENV)/installed  ## sweep the simulated rig through hunting and back; refit it; 3 minutes
	$(BIN)/hunt demo

demo-proof: $(VENV)/installed  ## the demo 20 times, to the first that ends without a form; RUNS=2: fewer
	for seed in $$(seq $${RUNS:-20}); do $(BIN)/hunt demo --seed $$seed --out build/demo_$$seed || exit 1; done

PYTEST := $(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder --durations=20

test: $(VENV)/installed check  ## all checks and tests but those of whole rigs, on two cores
	$(PYTEST) -m 'not (ros and slow)'

test-rig: $(VENV)/installed  ## tests that take minutes of a whole rig of real nodes
	$(PYTEST) -m 'ros and slow'

test-elsewhere: $(VENV)/installed  ## tests as on other machines (test/elsewhere.py); ONLY=one-core: that one; FAST=1: a few
	$(BIN)/python test/elsewhere.py $(if $(ONLY),--only $(ONLY)) $(if $(FAST),--fast)

test-kilted:  ## tests of the nodes on the rclpy of ROS 2 Kilted, in .venv-kilted
	$(MAKE) VENV=.venv-kilted ROS=ros-kilted test-nodes

test-nodes: $(VENV)/installed
	$(PYTEST) test/nodes

check: $(VENV)/installed  ## ruff, mypy, import directions
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-cache
	$(BIN)/codespell hunt_ros test docs config launch README.md CHANGELOG.rst CONTRIBUTING.md

format: $(VENV)/installed  ## let ruff mend what it can
	$(BIN)/ruff check --fix . ; $(BIN)/ruff format .

faults: $(VENV)/installed  ## make everything fail once, and print what came of it into docs/faults.md
	$(BIN)/python test/nodes/test_faults.py

gauntlet: $(VENV)/installed  ## random failures of a rig and its suite, in every order, into docs/faults.md; SCENARIOS=20 FIRST=100: which
	$(BIN)/python test/benchmark/gauntlet.py --first $${FIRST:-0} --scenarios $${SCENARIOS:-500} --publish

bench-interlock: $(VENV)/installed  ## limit cycles that the interlock avoids, in closed loop; KICKS=20: fewer
	$(BIN)/python test/benchmark/bench_interlock.py --kicks $${KICKS:-100} --publish

bench-trip: $(VENV)/installed  ## from a silent detector to a lower set point in the drive; TRIPS=20: fewer
	$(BIN)/python test/benchmark/bench_trip.py --trips $${TRIPS:-200} --publish

soak: $(VENV)/installed  ## the live suite for an hour at 8 times real time: leaks, losses, false alarms; 24 h: SPEEDUP=1 MINUTES=1440
	$(BIN)/python test/benchmark/soak.py --speedup $${SPEEDUP:-8} --minutes $${MINUTES:-60}

bench-live: $(VENV)/installed  ## what the live suite costs: CPU, memory, latency, losses, starts; one process too
	$(BIN)/python test/benchmark/bench_live.py --cold

bench-bags: $(VENV)/installed  ## recordings: columns against rosbags and mcap, an hour read and replayed
	$(BIN)/python test/benchmark/bench_bags.py

fuzz: $(VENV)/installed  ## damage 200,000 recordings more; FUZZ_SEED=N begins elsewhere
	$(BIN)/python test/bag/fuzz_bags.py --cases 200000 --seed $${FUZZ_SEED:-100000}

golden-bags: $(VENV)/installed  ## make the recordings in bags/ again, and the events expected of them
	$(BIN)/python bags/make.py

clean:  ## remove what these targets made
	rm -rf $(VENV) .venv-kilted build install log *.egg-info

bench-estimation: $(VENV)/installed  ## the tracker: speed, accuracy against the bounds
	$(BIN)/python test/benchmark/bench_estimation.py

$(VENV)/docs: $(VENV)/installed
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[docs]'
	@touch $@

docs: $(VENV)/docs  ## the documentation as a site, in build/site; a warning or a dead link fails
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict --config-file docs/site/mkdocs.yml

figures: $(VENV)/installed  ## draw the pictures of docs/
	$(BIN)/python docs/figures.py
	$(BIN)/python docs/animation.py

page-pictures: $(VENV)/installed  ## take the pictures of the page in docs/, with a Chromium
	$(BIN)/python docs/page_pictures.py

settings: $(VENV)/installed  ## write docs/settings.md from the code
	$(BIN)/python docs/settings.py

bench-forecast: $(VENV)/installed  ## forecast of v_c: error, spread against the bound, coverage
	$(BIN)/python test/benchmark/bench_forecast.py

bench-identification: $(VENV)/installed  ## identification beside its truth: the full model, other rigs, an hour, coverage
	$(BIN)/python test/benchmark/bench_identification.py

bench-peer: $(VENV)/installed  ## identification beside pysindy
	$(BIN)/python -m pip install --quiet --disable-pip-version-check 'pysindy>=2.0'
	$(BIN)/python test/benchmark/bench_peer.py

bench-plan: $(VENV)/installed  ## what to measure next: hunt plan in the loop against the staircase; FAST=1: 2 seeds
	$(BIN)/python test/benchmark/bench_plan.py $(if $(FAST),--fast)

bench-day: $(VENV)/installed  ## the detector on 500 random rigs and days; DAYS=50: fewer
	$(BIN)/python test/benchmark/bench_day.py --days $${DAYS:-500}

bench-detection: $(VENV)/installed  ## the detector against the railway criteria; SCALE=0.05: a quick look (1: 24 h quiet, 10 min)
	$(BIN)/python test/benchmark/bench_detection.py --scale $${SCALE:-1} --publish

.PHONY: page-pictures gauntlet bench-day settings test-rig wheel demo-proof soak docs bench-trip bench-interlock faults bench-plan bench-detection bench-identification bench-peer figures bench-bags fuzz golden-bags help install demo test test-kilted test-nodes test-elsewhere check format clean bench-live bench-forecast bench-estimation
