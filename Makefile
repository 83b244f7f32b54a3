# `make` alone explains itself.
VENV    := .venv
UNSHADE := $(VENV)/bin/unshade
PYTEST  := $(VENV)/bin/python -m pytest
LOCKS   := requirements.lock requirements-test.lock
TWICE   := -n 2 --dist loadfile# two files of tests at a time

.DEFAULT_GOAL := help
.PHONY: help sample fountain paper paper-quick accuracy accuracy-quick test test-quick test-all check docs reliability lock sbom benchmarks clean

help: ## show this
	@echo "Unshade: per-view albedo from photos or a COLMAP workspace."
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## (.*)/  make \1\t\2/' | expand -t 24
	@echo "Each sets up what it needs in $(VENV) by itself. On your own photos: $(UNSHADE) run --images DIR"

$(VENV)/.ready: pyproject.toml setup.sh $(LOCKS)
	sh setup.sh
	@touch $@

$(VENV)/.ready-test: pyproject.toml setup.sh $(LOCKS)
	sh setup.sh test
	@touch $@ $(VENV)/.ready

sample: $(VENV)/.ready ## the whole program on the embedded sample, from photos to albedo (minutes)
	$(UNSHADE) run configs/sample.yaml
	@echo "Look at workspaces/sample/output/report.html"

fountain: $(VENV)/.ready ## the real thing: 11 photos of a fountain (fetched, or from UNSHADE_DATA)
	$(UNSHADE) run configs/fountain.yaml
	@echo "Look at workspaces/fountain/output/report.html"

$(VENV)/.ready-synthetic: pyproject.toml setup.sh $(LOCKS)
	sh setup.sh synthetic
	@touch $@ $(VENV)/.ready

paper: $(VENV)/.ready-synthetic ## the paper's experiments at its size, renders included (hours); writes docs/paper
	$(VENV)/bin/python -m benchmarks.paper

paper-quick: $(VENV)/.ready-synthetic ## the same at a quarter of the size
	$(VENV)/bin/python -m benchmarks.paper --quick

accuracy: $(VENV)/.ready-synthetic ## albedo against truth on many scenes, all methods (hours; scans only with UNSHADE_DATA)
	$(VENV)/bin/python -m benchmarks.accuracy
	$(VENV)/bin/python -m benchmarks.accuracy --natural
	$(VENV)/bin/python -m benchmarks.accuracy.two_lights
	$(VENV)/bin/python -m benchmarks.accuracy.touched
	$(VENV)/bin/python -m benchmarks.accuracy.sensitivity
	test -z "$(UNSHADE_DATA)" || $(VENV)/bin/python -m benchmarks.accuracy.relighting

accuracy-quick: $(VENV)/.ready-synthetic ## the same on the paper's five rows, a tenth of their size
	$(VENV)/bin/python -m benchmarks.accuracy --quick

test: $(VENV)/.ready-test ## the fast tests
	$(PYTEST) $(TWICE) -m "not slow"

test-quick: $(VENV)/.ready-test ## those of them that take a minute together, while one works
	$(PYTEST) $(TWICE) -q -m "not slow and not whole"

test-all: $(VENV)/.ready-test ## all tests (the long ones take most of an hour; with node, a validator and a browser, with Python 3.11 Blender too)
	$(PYTEST) $(TWICE)

check: $(VENV)/.ready-test ## format, lint, types, numbers outside settings, generated documentation, vulnerabilities
	$(VENV)/bin/ruff format --check .
	$(VENV)/bin/ruff check .
	$(VENV)/bin/mypy
	$(VENV)/bin/python checks/numbers_outside_settings.py
	$(VENV)/bin/python docs/generate.py --check
	$(VENV)/bin/python checks/audit.py

docs: $(VENV)/.ready ## write the generated documentation anew
	$(VENV)/bin/python docs/generate.py

reliability: $(VENV)/.ready-test ## all attacks of tests/faults (an hour); writes docs/reliability.md
	rm -f workspaces/attacks.jsonl; mkdir -p workspaces
	UNSHADE_FAULT_LOG=$(CURDIR)/workspaces/attacks.jsonl $(PYTEST) tests/faults
	$(VENV)/bin/python -m tests.faults.report workspaces/attacks.jsonl

lock: $(VENV)/.ready-test ## write the lock files anew, with the versions that are installed
	$(VENV)/bin/python -m pip install --quiet uv
	$(VENV)/bin/python checks/lock.py

sbom: $(VENV)/.ready-test ## the software bill of materials of a release (CycloneDX), in dist/
	mkdir -p dist
	$(VENV)/bin/python checks/sbom.py dist/unshade.cdx.json

$(VENV)/.ready-benchmarks: pyproject.toml setup.sh $(LOCKS)
	sh setup.sh benchmarks
	@touch $@ $(VENV)/.ready

benchmarks: $(VENV)/.ready-benchmarks ## accuracy (after make sample, make fountain; MIT-Berkeley objects), solvers against rivals
	$(VENV)/bin/python -m benchmarks.dense_truth workspaces/sample
	$(VENV)/bin/python -m benchmarks.dense_truth --true-cameras
	$(VENV)/bin/python -m benchmarks.fountain_poses
	test -z "$(UNSHADE_DATA)" || $(VENV)/bin/python -m benchmarks.mit_berkeley --quick
	$(VENV)/bin/python -m benchmarks.solver --quick

clean: ## remove the environment and all caches of tools; workspaces stay
	rm -rf $(VENV) build *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
