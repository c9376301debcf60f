# Everything sets itself up: `make scan` and `make test` are all a stranger needs.
.PHONY: scan test check docs compiled bench soak licences pins image setup clean

# Programs that tests start would else compile all sources anew: 4 s each where it is set.
unexport PYTHONDONTWRITEBYTECODE

# As the program sets it before it loads NumPy: times of benches are those of the program.
export OPENBLAS_NUM_THREADS = 1

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PLAIN := $(VENV)/plain
# One more than there are cores: many tests wait for a controller's or a vehicle's clock.
WORKERS := $(shell expr 1 + $$(getconf _NPROCESSORS_ONLN))
READY := $(VENV)/ready
SYSTEM_LIBRARIES := libEGL.so.1 libGL.so.1 libgomp.so.1 libidn2.so.0 libudev.so.1 libusb-1.0.so.0 libX11.so.6
SYSTEM_PACKAGES := libegl1 libgl1 libgomp1 libidn2-0 libudev1 libusb-1.0-0 libx11-6
PIP := $(BIN)/pip install --quiet --disable-pip-version-check --no-compile -c constraints.txt

scan: $(PLAIN)
	$(BIN)/tjscan scan examples/paper.toml

test: $(READY)
	@# Tests of vehicles want a broker, those of pages a browser; they are skipped without, but on CI.
	@command -v mosquitto >/dev/null || test -x /usr/sbin/mosquitto \
		|| { apt-get update -qq && apt-get install -y -qq mosquitto; } >/dev/null 2>&1 || true
	@command -v chromium >/dev/null \
		|| { apt-get update -qq && apt-get install -y -qq --no-install-recommends chromium; } >/dev/null 2>&1 || true
	$(BIN)/pytest -n $(WORKERS) --dist loadfile --no-loadscope-reorder --durations 25 --hypothesis-profile thorough

check: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy --num-workers auto
	$(BIN)/lint-imports
	$(BIN)/python .ci/weight.py

# The documentation as pages in site/: no warning, no dead link, nothing that a page would fetch.
docs: $(READY)
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet

# A minute of Numba, kept beside the sources: the tests' processes would else all do it.
compiled: $(READY)
	$(BIN)/pytest tests/towing/test_start_shape.py -k compiled

bench: $(READY)
	@status=0; for file in $(filter-out bench/reliability.py bench/paper_tables.py,$(wildcard bench/[a-z]*.py)); do $(BIN)/python $$file || status=1; done; exit $$status

# Kills, cuts, full disks, arms moved meanwhile, bad sensors, bad files, spoilt runs, wire faults.
# See docs/reliability.md.
soak: $(READY)
	$(BIN)/python bench/reliability.py

# The licence of every installed package; fails where one is stronger than the LGPL.
licences: $(READY)
	$(BIN)/python bench/licences.py

# Hashes of what constraints.txt pins, all extras included.
pins: $(READY)
	$(BIN)/python -c 'import tomllib; p = tomllib.load(open("pyproject.toml", "rb"))["project"]; \
		print(*p["dependencies"], *sum(p["optional-dependencies"].values(), []), sep="\n")' \
		> $(VENV)/needed.txt
	$(BIN)/pip install --quiet --dry-run --ignore-installed --only-binary :all: \
		--report $(VENV)/report.json -c constraints.txt -r $(VENV)/needed.txt
	$(BIN)/python bench/_pins.py < $(VENV)/report.json > requirements-hashed.txt

# The container; where no docker runs, its steps are followed in an empty Debian, and it scans.
image:
	@if docker version >/dev/null 2>&1; then docker build --tag tjscan .; else $(PYTHON) bench/_image.py; fi

setup: $(READY)

$(BIN)/pip:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
		|| { echo "tjscan needs Python 3.11 or newer; set PYTHON=... to choose one"; exit 1; }
	@$(PYTHON) -c 'import ctypes, sys; [ctypes.CDLL(name) for name in sys.argv[1:]]' $(SYSTEM_LIBRARIES) 2>/dev/null \
		|| { apt-get update -qq && apt-get install -y -qq $(SYSTEM_PACKAGES); } >/dev/null 2>&1 \
		|| { echo "tjscan needs libraries of the system: sudo apt-get install $(SYSTEM_PACKAGES)"; exit 1; }
	@$(PYTHON) -m venv --clear $(VENV) \
		|| { rm -rf $(VENV); echo "python3-venv is missing: sudo apt-get install python3-venv"; exit 1; }

# What `pip install tjscan` brings, and no more.
$(PLAIN): pyproject.toml constraints.txt tjscan/groove/_kernel.c | $(BIN)/pip
	@echo "setting up $(VENV): some two minutes, once"
	$(PIP) -e .
	@touch $@

# The same and what tests, checks, documents and benchmarks need, in one step.
$(READY): pyproject.toml constraints.txt tjscan/groove/_kernel.c loopback/pyproject.toml | $(BIN)/pip
	@echo "setting up $(VENV): some two minutes, once"
	$(PIP) -e '.[dev,docs,browser,e57,genicam,live,pandas,power,step,study,towing,ur,vehicle,weldx]' -e ./loopback
	@touch $(PLAIN) $@

clean:
	rm -rf $(VENV) build loopback/build site .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
