# make demo   Waldo on the committed bag, through real ROS 2 nodes
# make test   the tests that take minutes; make test-all adds the slow ones
# make test-pages   what people follow, see and install: tutorials and how-tos word by word, pages in a browser, packages;
#   and a graph on two machines
# make inspect   the page on which Waldo is seen to think, for the committed bag
# make evaluate   how well people are seen, by HOG and by the network, beside the paper's tables
# make check  style and types
# make interfaces   builds and installs socialbot_msgs, the messages as ROS types of their own; make test tests them then
# make robot-interfaces   builds and installs ROS types of robots that the wheels lack; make test-all tests robots with them
# make EXTRA   installs an extra of pyproject.toml: sim, voices, up, dask, ...; docs/installation.md lists them
# make viewers   installs the packages of Rerun and Foxglove; make test holds what `socialbot export` writes against them then
# make sim   installs MuJoCo; make test runs the warehouse and the ward with physics then
# make reception   replays the recorded visit of the reception and checks what Waldo did
# make voices   installs a neural voice; make test tests it then
# make hear   installs speech recognition with a model of 133 MB; make test hears with it then
# make docs   the site, in site/
# make dist   wheel, source archive and the versions to install them with, in dist/
# make fuzz   bytes that follow what the code does with them, for each reader; DECODER=graph SECONDS=600 for one of them,
#             SECONDS=3600 PART=1/10 to PART=10/10 for a tenth of them in a night
# All set up .venv first, from the pinned and hashed requirements.lock; what tests and checks need besides stands in
# requirements-dev.lock, and comes with the first of them.

PYTHON ?= python3
NAMED := $(filter-out file,$(origin PYTHON))
# An activated .venv has no pip: the Python that it was made with installs into it.
override PYTHON := $(or $(shell $(PYTHON) -c 'import os, sys; \
  made = os.path.join(sys.base_prefix, "bin", "python%d.%d" % sys.version_info[:2]); \
  print(made if os.path.realpath(sys.prefix) == os.path.realpath(".venv") else "")'),$(PYTHON))
VENV := .venv
BIN := $(VENV)/bin
BAG := data/synthetic/corridor
SCENES := $(addprefix data/synthetic/,scene1_tune scene1_heldback scene2_tune scene2_heldback)
PAGES := tests/system/test_pages.py tests/runs/test_page*.py tests/runs/test_pages_in_browser.py tests/test_package.py
MACHINES := tests/system/test_deployment.py::test_two_machines_run_one_graph
JOBS ?= 2
# More than processors: system tests wait for other processes.
WORKERS ?= 3
SECONDS ?= 30
# Without the compiled files, each of the many processes that tests start would compile all modules again.
unexport PYTHONDONTWRITEBYTECODE
# On a terminal pip shows what it downloads; into a log it only tells what goes wrong.
INSTALL = $(PYTHON) -m pip --python $(BIN)/python install --disable-pip-version-check $(shell [ -t 2 ] || echo --quiet)

# Extras with a target that installs them, and nothing else. `fuzz` and `docs` also use what they install.
EXTRAS := bench dask dev evaluation foxglove hear-model onnx project rerun sim speech up voices

.PHONY: setup tools demo inspect evaluate test test-all test-pages fuzz interfaces robot-interfaces viewers hear reception check docs dist lock clean $(EXTRAS)

# Another Python would need another environment; extras may be installed in this one, and commands may run from it.
setup: $(VENV)/installed
	@[ -z "$(NAMED)" ] || $(PYTHON) -c 'import os, sys; here = "%d.%d" % sys.version_info[:2]; sys.exit( \
	  0 if os.path.isdir("$(VENV)/lib/python" + here) \
	  else "error: $(VENV) was made with another Python than " + here + "; remove it first: rm -r $(VENV)")'

# The venv gets no pip of its own: a Debian without python3-venv has none to give.
$(VENV)/installed: requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; v = sys.version_info; sys.exit(not (3, 10) <= v[:2] <= (3, 14))' \
	  || { echo "error: Python 3.10 to 3.14 is needed; name one with 'make PYTHON=python3.11 ...'" >&2; exit 5; }
	@$(PYTHON) -m pip --help 2> /dev/null | grep -q -e ' --python ' \
	  || { echo "error: $(PYTHON) needs pip 22.3 or newer; install it (Debian, Ubuntu: apt install python3-pip)," \
	    "and if it is older: $(PYTHON) -m pip install --upgrade pip" >&2; exit 5; }
	$(PYTHON) -m venv --clear --without-pip $(VENV)
	$(INSTALL) --no-compile --require-hashes -r requirements.lock
	$(INSTALL) --no-deps --no-build-isolation -e .
	@touch $@

tools: setup $(VENV)/tools-installed

$(VENV)/tools-installed: $(VENV)/installed requirements-dev.lock
	$(INSTALL) --require-hashes -r requirements-dev.lock
	@touch $@

demo: setup
	$(BIN)/socialbot replay $(BAG) --runner ros $(if $(OUT),--out $(OUT))

inspect: runs/waldo/results.json
	$(BIN)/socialbot inspect runs/waldo $(if $(DISPLAY)$(WAYLAND_DISPLAY),--open)

# The folder gets its name only when the run is whole.
runs/waldo/results.json: | setup
	rm -rf runs/waldo runs/waldo.part
	$(BIN)/socialbot replay $(BAG) --no-video --out runs/waldo.part
	mv runs/waldo.part runs/waldo

evaluate: setup
	$(BIN)/socialbot evaluate $(SCENES) --split held-back --detector nanodet,hog --jobs $(JOBS) $(if $(OUT),--out $(OUT))

test: tools
	$(BIN)/python -m pytest -n $(WORKERS) --dist loadgroup -m "not slow" --hypothesis-profile quick

test-all: tools
	$(BIN)/python -m pytest -n $(WORKERS) --dist loadgroup

test-pages: tools
	$(BIN)/python -m pytest -n $(WORKERS) --dist loadgroup -m slow $(PAGES) $(MACHINES)

fuzz: tools
	$(INSTALL) --no-build-isolation -e '.[fuzz]'
	for decoder in $(or $(DECODER),$$($(BIN)/python tools/fuzz.py --list $(PART))); do \
	  $(BIN)/python tools/fuzz.py $$decoder -max_total_time=$(SECONDS) || exit 1; done

interfaces: setup
	$(INSTALL) --no-deps ./interfaces/socialbot_msgs

robot-interfaces: setup
	$(INSTALL) --no-deps ./interfaces/robot_interfaces

$(EXTRAS): setup
	$(INSTALL) --no-build-isolation -e '.[$@]'

reception: setup
	rm -rf runs/reception
	$(BIN)/socialbot demo reception --no-video --out runs/reception
	$(BIN)/socialbot test reception runs/reception --strict
	$(BIN)/socialbot test reception socialbot/agents/reception/bag --graph reception --strict

hear: setup
	$(INSTALL) --no-build-isolation -e '.[hear,hear-model]'

viewers: setup
	$(INSTALL) --no-build-isolation -e '.[rerun,foxglove]'

check: tools
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright --pythonpath $(BIN)/python

docs: setup
	$(INSTALL) --no-build-isolation -e '.[docs]'
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet

# pip takes no hashes for constraints of a package that has none itself.
dist: setup
	rm -rf dist
	$(BIN)/hatchling build
	sed '/--hash/d; s/ \\$$//' requirements-dev.lock > dist/constraints.txt

# Newest versions within the bounds of pyproject.toml, for all Pythons at once; needs uv.
LOCK := uv pip compile --universal --generate-hashes --python-version 3.10 \
  --no-header --no-annotate --no-emit-index-url --no-emit-find-links pyproject.toml
lock:
	$(LOCK) --extra speech --extra dev --upgrade -o requirements-dev.lock
	$(LOCK) --extra speech --extra project --constraint requirements-dev.lock -o requirements.lock

clean:
	rm -rf $(VENV) runs site dist
