# Everything sets up .venv by itself: Python 3.11 or later, make, gcc and a package registry suffice.
PYTHON ?= python3
BIN := .venv/bin
STAMP := .venv/.installed
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check
DEV := -c constraints.txt -e '.[dev]'
# Hundreds of processes start in the tests: what Python compiles is kept, whatever the shell says.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test check lint docs package format bench validate fuzz setup clean

setup: $(STAMP)

# uv takes a tenth of pip's time, but does not read pip's settings: where it fails, pip installs.
$(STAMP): pyproject.toml constraints.txt
	@test -x $(BIN)/python || $(PYTHON) -m venv .venv
	$(PIP) -c constraints.txt uv && $(BIN)/uv pip install --quiet --python $(BIN)/python $(DEV) || $(PIP) $(DEV)
	@touch $(STAMP)

demo: $(STAMP)
	$(BIN)/penode demo --out out/demo

# Two processes of one thread each: BLAS with two would wait for its own.
test: $(STAMP)
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder

check: lint docs

lint: $(STAMP)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

docs: $(STAMP)
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet

package: $(STAMP)
	rm -rf out/dist
	$(BIN)/uv build --quiet --out-dir out/dist
	$(BIN)/uv tool run --quiet twine check --strict out/dist/*.whl out/dist/*.tar.gz

format: $(STAMP)
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

bench: $(STAMP)
	$(BIN)/python -m benchmarks.run

validate: $(STAMP)
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 --dist worksteal -m slow
	$(BIN)/python -m validate.random_starts
	$(BIN)/python -m validate.horizon_choice
	$(BIN)/python -m validate.conventions
	$(BIN)/python -m validate.flux_maps
	$(BIN)/python -m validate.imperfections
	$(BIN)/python -m validate.imperfect_drives
	$(BIN)/python -m validate.misfitting_drives
	$(BIN)/python -m validate.aliasing
	$(BIN)/python -m validate.operating_points
	$(BIN)/python -m validate.recordings_as_they_are
	$(BIN)/python -m validate.noise_models 40
	$(BIN)/python -m validate.through_command 80
	$(BIN)/python -m validate.drawn_physics 3
	$(BIN)/python -m fuzz.readers --seconds 300
	$(BIN)/python -m validate.interruption
	$(BIN)/python -m validate.sweep_interruption 10
	$(BIN)/python -m validate.full_disk
	$(BIN)/python -m validate.repetition 20
	$(BIN)/python -m validate.bad_files

fuzz: $(STAMP)
	$(BIN)/python -m fuzz.readers --seconds 3600

clean:
	rm -rf .venv out .mypy_cache .ruff_cache .pytest_cache .import_linter_cache
