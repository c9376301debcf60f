# Everything sets itself up: `make scan` and `make test` are all a stranger needs.
.PHONY: scan test check bench soak licences pins setup clean

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/ready

scan: $(READY)
	$(BIN)/tjscan scan examples/paper.toml

test: $(READY)
	@# Tests of vehicles want a broker, those of pages a browser; they are skipped without.
	@command -v mosquitto >/dev/null || test -x /usr/sbin/mosquitto \
		|| { apt-get update -qq && apt-get install -y -qq mosquitto; } >/dev/null 2>&1 || true
	@command -v chromium >/dev/null \
		|| { apt-get update -qq && apt-get install -y -qq --no-install-recommends chromium; } >/dev/null 2>&1 || true
	$(BIN)/pytest -n auto --dist loadfile --hypothesis-profile thorough

check: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

bench: $(READY)
	@status=0; for file in $(filter-out bench/reliability.py,$(wildcard bench/[a-z]*.py)); do $(BIN)/python $$file || status=1; done; exit $$status

# Half an hour on two idle cores: kills, cuts, full disks, bad sensors, bad files, spoilt runs.
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

setup: $(READY)

$(READY): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
		|| { echo "tjscan needs Python 3.11 or newer; set PYTHON=... to choose one"; exit 1; }
	@$(PYTHON) -c 'import ctypes; ctypes.CDLL("libusb-1.0.so.0")' 2>/dev/null \
		|| { apt-get update -qq && apt-get install -y -qq libusb-1.0-0; } >/dev/null 2>&1 \
		|| { echo "open3d needs a system library: sudo apt-get install libusb-1.0-0"; exit 1; }
	@test -x $(BIN)/pip || $(PYTHON) -m venv --clear $(VENV) \
		|| { rm -rf $(VENV); echo "python3-venv is missing: sudo apt-get install python3-venv"; exit 1; }
	@echo "setting up $(VENV): some two minutes, once"
	$(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[dev,browser,live,study,towing,ur,vehicle]'
	@touch $@

clean:
	rm -rf $(VENV) build .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
