# Targets that need .venv or a renderer set them up first, where missing: see scripts/setup.sh.
#   make PYTHON=python3.12 setup      choose the Python that .venv is made from
#   make ARGS='-x -k video' test      more arguments for pytest, or for the command of make demo

.DEFAULT_GOAL := help
.NOTPARALLEL:
.PHONY: help setup setup-python demo gallery test quick explore test-lowest lint types check loaders bench score docs release-check clean

help: ## list the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "make %-11s  %s\n", $$1, $$2}' Makefile

setup: ## make .venv with mjrun and its tools, and see that something can draw
	@sh scripts/setup.sh

setup-python:
	@sh scripts/setup.sh python

demo: setup ## render a video: out/dominos.mp4
	@mkdir -p out
	.venv/bin/mjrun video scenes/dominos.xml --camera top --duration 3 --size 640x360 --fps 30 -o out/dominos.mp4 $(ARGS)
	@echo "The video is $(CURDIR)/out/dominos.mp4"

gallery: setup ## make the videos, images, tables and plots of all scenes at full size: out/
	for scene in scenes/*.xml; do .venv/bin/mjrun run "$${scene%.xml}.yaml" -o "out/$$(basename "$$scene" .xml)" || exit; done

test: setup ## run the tests
	.venv/bin/pytest -n auto --maxprocesses 4 --dist worksteal $(ARGS)

quick: setup ## run the tests without the slow ones
	.venv/bin/pytest -n auto --maxprocesses 4 --dist worksteal -m 'not slow' $(ARGS)

explore: setup ## run the property tests on examples drawn at random; add what fails as @example
	.venv/bin/pytest -n auto --maxprocesses 4 --dist worksteal -m hypothesis --hypothesis-profile explore $(ARGS)

# Tests of what libraries with a lower bound in pyproject.toml decide.
LOWEST = tests/test_packages.py tests/formats tests/document tests/plotting tests/diff tests/policy tests/gym \
  tests/task/test_external_environment.py tests/task/test_description.py tests/model/sources/test_gym.py \
  tests/physics/test_random_distribution.py tests/physics/test_warp_engine.py tests/experiment/test_design.py \
  tests/study/test_executors.py tests/fitting/test_gauss_newton.py tests/fitting/test_limited_chirps.py tests/fitting/test_shooting_problem.py \
  tests/experiment/test_statistics.py tests/evaluation/test_table.py tests/cli/test_click_command.py \
  tests/cli/test_console.py tests/cli/test_terminal_layout.py tests/cli/commands/test_schema.py tests/outputs/mcap

test-lowest: setup ## run the tests of what libraries do, with the lowest version of each that mjrun accepts: .venv-lowest
	.venv/bin/python scripts/lowest_versions.py > .venv/lowest.txt
	.venv/bin/python -m venv .venv-lowest
	.venv-lowest/bin/python -m pip install --quiet 'pip>=25.1'
	.venv-lowest/bin/python -m pip install --quiet --constraint .venv/lowest.txt --editable '.[all,dask,ray,slurm,warp]' --group dev
	.venv-lowest/bin/pytest -n auto --maxprocesses 4 --dist worksteal -W default $(LOWEST) $(ARGS)

loaders: setup ## read datasets with Ultralytics and the BOP toolkit, which need PyTorch
	.venv/bin/python -m pip install --quiet 'pip>=25.1'
	.venv/bin/python -m pip install --quiet --group loaders
	@# Without its dependencies, among which is numpy below 2, though what the tests use works with numpy 2.
	.venv/bin/python -m pip install --quiet --no-deps git+https://github.com/thodan/bop_toolkit
	.venv/bin/pytest tests/formats/datasets/test_loaders.py $(ARGS)

lint: setup-python ## check the code's style and layout
	.venv/bin/ruff check
	.venv/bin/ruff format --check

types: setup-python ## check the types of the code, and of tests that use the Python interface
	PYRIGHT_PYTHON_IGNORE_WARNINGS=1 .venv/bin/pyright

check: lint types test ## lint, types and test

bench: setup ## time videos, traces, exports and start-up against their baselines, and views
	.venv/bin/python -m pip install --quiet --group bench
	.venv/bin/python benchmarks/video.py
	.venv/bin/python benchmarks/trace.py
	.venv/bin/python benchmarks/views.py
	.venv/bin/python benchmarks/plot.py
	.venv/bin/python benchmarks/export.py
	.venv/bin/python benchmarks/startup.py

score: setup ## measure faults, hostile input and determinism, and write SCORE.md
	.venv/bin/python -m tests.scoreboard $(ARGS)

docs: setup ## build the site of the documentation: out/site/index.html
	.venv/bin/python scripts/make_docs.py

release-check: docs ## build the release in dist, and try it in a fresh environment
	.venv/bin/python scripts/release_check.py

clean: ## remove outputs, packages and caches; .venv stays
	rm -rf out dist .pytest_cache .ruff_cache .hypothesis
	find mjrun tests benchmarks -name __pycache__ -prune -exec rm -rf {} +
