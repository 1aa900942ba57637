# Every target first sets up what it needs: a virtual environment in .venv with the pinned
# packages, and the system libraries for rendering.
PYTHON ?= python3
BIN := .venv/bin

# Four workers keep two cores busy: many tests wait for sockets and other processes.
# They take the files in the order of tests/conftest.py.
PYTEST := $(BIN)/python -m pytest -n 4 --dist loadfile --no-loadscope-reorder
# Workers, and the processes that tests start, read what others have compiled.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test test-fast test-learn test-lerobot golden coverage lint types docs models experiments bench-guard package lock clean

demo: .venv/ready  ## run the main job, record it, and say what to open and to try next
	$(BIN)/drake-srg demo

test: .venv/ready  ## run the test suite
	$(PYTEST)

test-fast: .venv/ready  ## run the tests that take a minute, for every save
	$(PYTEST) -m "not slow"

# TORCH="torch==VERSION", with options of pip, chooses a build: PyPI's newest brings CUDA.
# gymnasium's wrappers NumpyToTorch and RecordVideo need the last two packages.
TORCH ?= torch
test-learn: .venv/ready  ## run the tests of the extra `learn`, in an environment of its own
	test -x .venv-learn/bin/python || $(PYTHON) -m venv .venv-learn
	$(BIN)/uv pip install --quiet --python .venv-learn -r requirements.lock
	.venv-learn/bin/python -m pip install --quiet --disable-pip-version-check $(TORCH)
	.venv-learn/bin/python -m pip install --quiet --disable-pip-version-check \
		--no-build-isolation --editable ".[learn]" array-api-compat==1.16.0 moviepy==2.2.1
	.venv-learn/bin/python -m pytest -m learn tests/learning tests/suite tests/cli/test_learn.py

# LeRobot bounds packages below requirements.lock, so pip chooses here. `LEROBOT_PYTHON`
# is 3.12 or newer.
LEROBOT_PYTHON ?= python3
test-lerobot:  ## run the tests of the extra `lerobot`, in an environment of its own
	test -x .venv-lerobot/bin/python || $(LEROBOT_PYTHON) -m venv .venv-lerobot
	.venv-lerobot/bin/python -m pip install --quiet --disable-pip-version-check \
		--editable ".[lerobot]" examples/lerobot hypothesis pytest
	.venv-lerobot/bin/python -m pytest -m lerobot tests/suite tests/sweeps/dataset
	.venv-lerobot/bin/python -m pytest tests/suite/test_env.py tests/planning/motion/test_time_parameterization.py

golden: .venv/ready  ## compare all scenarios' bytes with the committed ones (QUICK=1, ONLY="a b", ACCEPT=1)
	PYTHONPATH=tools $(BIN)/python -m golden $(if $(ONLY),--only $(ONLY)) \
		$(if $(filter 1,$(QUICK)),--quick) $(if $(filter 1,$(ACCEPT)),--accept)

coverage: .venv/ready  ## run the test suite and list the lines it misses
	$(PYTEST) --cov --cov-report=term-missing:skip-covered

lint: .venv/ready
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: .venv/ready
	$(BIN)/mypy

docs: .venv/ready  ## build the site out/site/html/index.html, and check it
	PYTHONPATH=tools $(BIN)/python -m make_site

models: .venv/ready  ## regenerate models/
	$(BIN)/python tools/build_models.py

package: .venv/ready  ## build sdist and wheel in dist/, and try the wheel
	sh tools/try_package.sh

# Without ONLY, EXCEPT or QUICK, this takes hours; it resumes where it was cut off.
experiments: .venv/ready  ## rerun experiments, compare them with docs (ONLY="a b", EXCEPT="c", QUICK=1, ACCEPT=1)
	$(BIN)/python -m experiments all \
		$(if $(ONLY),--only $(ONLY)) $(if $(EXCEPT),--except $(EXCEPT)) \
		$(if $(filter 1,$(QUICK)),--quick) $(if $(filter 1,$(ACCEPT)),--accept)

bench-guard: .venv/ready  ## fail if a run is 15 % slower, over its bare plant, than committed
	$(BIN)/python -m experiments all --only overhead

# Every extra but the large ones, `learn` and `lerobot`.
LOCKED := dev docs import models ray ros2 sweep

# Keeps what is pinned; `make lock UPGRADE="-P drake"` moves a package, `-U` all of them.
lock: .venv/ready  ## pin the packages of pyproject.toml for every supported Python
	$(BIN)/uv pip compile --universal --python-version 3.11 --only-binary :all: \
		$(foreach extra,$(LOCKED),--extra $(extra)) --no-annotate --quiet --custom-compile-command "make lock" \
		$(UPGRADE) pyproject.toml --output-file requirements.lock

.venv/ready: requirements.lock pyproject.toml tools/install_system_libraries.sh
	sh tools/install_system_libraries.sh
	test -x $(BIN)/python || $(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -r requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps \
		--no-build-isolation --editable .
	touch $@

clean:
	rm -rf .venv out dist
