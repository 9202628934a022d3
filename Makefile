# make demo   Waldo on the committed bag, through real ROS 2 nodes
# make test   the tests that take minutes; make test-all adds the slow ones
# make evaluate   how well people are seen, by HOG and by the network, beside the paper's tables
# make check  style and types
# make fuzz   bytes that follow what the code does with them, for each reader; DECODER=graph SECONDS=600 for one of them
# All set up .venv first, from the pinned and hashed requirements.lock.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
BAG := data/synthetic/corridor
SCENES := $(addprefix data/synthetic/,scene1_tune scene1_heldback scene2_tune scene2_heldback)
JOBS ?= 2
SECONDS ?= 30

.PHONY: setup demo evaluate test test-all fuzz check lock clean

setup: $(VENV)/installed

# The venv gets no pip of its own: a Debian without python3-venv has none to give.
$(VENV)/installed: requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; v = sys.version_info; sys.exit(not (3, 10) <= v[:2] <= (3, 14))' \
	  || { echo "error: Python 3.10 to 3.14 is needed; name one with 'make PYTHON=python3.11 ...'"; exit 5; }
	$(PYTHON) -m venv --clear --without-pip $(VENV)
	$(PYTHON) -m pip --python $(BIN)/python install --quiet --disable-pip-version-check --require-hashes -r requirements.lock
	$(PYTHON) -m pip --python $(BIN)/python install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	@touch $@

demo: setup
	$(BIN)/socialbot replay $(BAG) $(if $(OUT),--out $(OUT))

evaluate: setup
	$(BIN)/socialbot evaluate $(SCENES) --split held-back --detector nanodet,hog --jobs $(JOBS) $(if $(OUT),--out $(OUT))

test: setup
	$(BIN)/python -m pytest -n $(JOBS) --dist loadgroup -m "not slow"

test-all: setup
	$(BIN)/python -m pytest -n $(JOBS) --dist loadgroup

fuzz: setup
	$(PYTHON) -m pip --python $(BIN)/python install --quiet --disable-pip-version-check 'atheris>=2.3,<4'
	for decoder in $(or $(DECODER),$$($(BIN)/python tools/fuzz.py --list)); do \
	  $(BIN)/python tools/fuzz.py $$decoder -max_total_time=$(SECONDS) || exit 1; done

check: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright --pythonpath $(BIN)/python

# Newest versions within the bounds of pyproject.toml, for all Pythons at once; needs uv.
lock:
	uv pip compile --universal --generate-hashes --python-version 3.10 --extra speech --extra dev --upgrade \
	  --no-header --no-annotate --no-emit-index-url --no-emit-find-links pyproject.toml -o requirements.lock

clean:
	rm -rf $(VENV) runs
