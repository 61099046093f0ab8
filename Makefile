# Scenegate's recipes. Nothing but make and Python 3.11 - 3.14 has to be there beforehand.
#
#   make run                      set up, serve with the demo scene
#   make run ARGS="--port 9000"   any flag of `scenegate serve`
#   make test ARGS="-k tiff"      any argument of pytest
#   make test-all                 the slow tests, too

VENV ?= .venv
SITE_VENV ?= .venv-site
PYTHON ?= $(firstword $(foreach p,python3.11 python3.12 python3.13 python3.14 python3,$(shell command -v $(p) 2>/dev/null)))
ARGS ?=
COSMIC_RAY := 8.7.0
# The protoc in it writes classes for protobuf 3.20 and newer; that of grpcio-tools 1.63 needs 5.26, later ones still more.
GRPCIO_TOOLS := 1.62.3
KUBERNETES_VALIDATE := 1.37.0
ZIZMOR := 1.32.0

# Of the image recipes.
ENGINE ?= docker
IMAGE ?= scenegate
TAG ?= latest

# Sources of the browser view; they are checked where node is 20 or newer.
WEB := gateway/adapters/viewer/web
NODE := $(shell command -v npm >/dev/null && node -p 'process.versions.node.split(".")[0] >= 20 || ""' 2>/dev/null)

BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check
UV := $(BIN)/uv
UVX := $(UV) tool run --quiet --python $(BIN)/python
comma := ,

# The same arguments for uv (seconds) and, where uv has no wheel or cannot reach the index, for pip.
install = { test -x $(UV) && $(UV) pip install --quiet --python $(BIN)/python $(1); } || $(PIP) install --quiet $(1)

# Pages have an edit link if the repository has an address: that of pyproject.toml, or of the environment.
SITE_REPO_URL ?= $(shell sed -n 's/^Repository = "\(.*\)"/\1/p' pyproject.toml)
SITE_ENV = SITE_REPO_URL="$(SITE_REPO_URL)" SITE_EDIT_URI="$(if $(SITE_REPO_URL),edit/main/docs/)"

.DEFAULT_GOAL := help
.PHONY: help run test test-all test-lowest lint check check-web lock generate docs web bench docs-site docs-serve mutants clean

help: ## this list
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/make \1\t\2/p' $(firstword $(MAKEFILE_LIST)) | expand -t 20

run: $(VENV)/.installed ## set up and serve on http://127.0.0.1:8000 with the demo scene
	@exec $(BIN)/scenegate serve --demo $(ARGS)

# As many processes as processors, each with half of the files; who is done takes of the others' (ARGS=-n0: one process).
PYTEST := $(BIN)/python -m pytest -n auto --maxprocesses 8 --dist worksteal
# Tests start a hundred interpreters, each of which would compile Python's sources in memory where this is set.
unexport PYTHONDONTWRITEBYTECODE
# What every command imports. Where that is set, each command would compile it in memory, for 1.5 s.
WRITE_BYTECODE := import gateway.app, gateway.cli.commands, gateway.cli.render_dataset, numba; numba.njit(lambda: 0)()

test: $(VENV)/.installed-dev ## set up and run the tests that take seconds, all rooms
	$(PYTEST) -m "not slow" $(ARGS)

test-all: $(VENV)/.installed-dev ## set up and run all tests
	$(PYTEST) $(ARGS)

test-lowest: $(VENV)/.tools ## run the fast tests with the lowest versions of libraries that pyproject.toml allows
	$(UV) venv --quiet --clear --python $(BIN)/python .venv-lowest
	$(UV) pip install --quiet --python .venv-lowest/bin/python --resolution lowest-direct --no-sources --editable ./client --editable '.[robots]'
	$(UV) pip install --quiet --python .venv-lowest/bin/python --group test --group tools pip ruamel.yaml setuptools
	.venv-lowest/bin/python -m pytest -m "not slow" -W ignore::DeprecationWarning --ignore tests/docs/generated $(ARGS)

lint: $(VENV)/.installed-dev ## lint and format only, in a second
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

check: lint $(if $(NODE),check-web) ## lint, format, types, import contracts, compose file, files for GitHub; the page, with node
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/check-jsonschema --builtin-schema vendor.compose-spec docker-compose.yml
	$(BIN)/check-jsonschema --builtin-schema vendor.github-workflows .github/workflows/*.yml
	$(BIN)/check-jsonschema --builtin-schema vendor.dependabot .github/dependabot.yml
	$(BIN)/check-jsonschema --builtin-schema vendor.github-issue-config .github/ISSUE_TEMPLATE/config.yml
	$(BIN)/check-jsonschema --builtin-schema vendor.github-issue-forms .github/ISSUE_TEMPLATE/[!c]*.yml

.PHONY: check-deploy dist dist-test publish image image-test image-push image-index release

check-deploy: $(VENV)/.tools ## Kubernetes objects and workflows, by programs that uv fetches; actionlint where it is installed
	$(UVX) --from kubernetes-validate==$(KUBERNETES_VALIDATE) kubernetes-validate --strict --quiet \
		$(filter-out %/kustomization.yaml %/service-monitor.yaml,$(wildcard deploy/kubernetes/*.yaml))
	$(UVX) zizmor@$(ZIZMOR) --quiet --offline .github
	if command -v actionlint >/dev/null; then actionlint; fi

dist: $(VENV)/.tools ## build the sdists of client and server and, from them, the wheels into dist/
	$(UV) build --quiet --clear --no-build-isolation --python $(BIN)/python -o dist client
	$(UV) build --quiet --no-build-isolation --python $(BIN)/python -o dist .

dist-test: $(VENV)/.installed-dev dist ## install the wheels of dist/ in empty environments, serve the demo from it
	SCENEGATE_DIST=dist $(BIN)/python -m pytest tests/packaging $(ARGS)

publish: $(VENV)/.tools ## upload dist/ to the package index, first the client that the server needs (ARGS=--dry-run: check only)
	@grep -q '^Repository = ' pyproject.toml || { echo "Set Repository in pyproject.toml: see Release in CONTRIBUTING.md."; exit 1; }
	$(UV) publish $(ARGS) dist/scenegate_client-*
	$(UV) publish $(ARGS) dist/scenegate-*

image: ## build the container image (ENGINE=podman, IMAGE=name, TAG=latest)
	DOCKER_BUILDKIT=1 $(ENGINE) build -t $(IMAGE):$(TAG) $(if $(CA),--secret id=ca$(comma)src=$(CA)) -f deploy/Dockerfile .

image-test: $(VENV)/.installed-dev ## build the images and run every profile of docker-compose.yml with ENGINE
	$(BIN)/python -m pytest tests/compose/test_containers.py -k $(ENGINE) $(ARGS)

# The default builder cannot attach an SBOM and provenance.
image-push: ## build and push the image of this machine's architecture, with SBOM and provenance
	docker buildx inspect scenegate >/dev/null 2>&1 || docker buildx create --name scenegate --driver docker-container
	docker buildx build --builder scenegate --push --sbom=true --provenance=mode=max -t $(IMAGE):$(TAG) -f deploy/Dockerfile .

image-index: ## join the pushed TAG-amd64 and TAG-arm64 as TAG and latest
	docker buildx imagetools create -t $(IMAGE):$(TAG) -t $(IMAGE):latest $(IMAGE):$(TAG)-amd64 $(IMAGE):$(TAG)-arm64

release: ## set VERSION=1.2.3 in all files that name it, commit, tag; pushing the tag publishes
	@$(PYTHON) tools/release.py "$(VERSION)"

bench: $(VENV)/.installed-dev ## measure against real peers, write bench/results.md (BENCH=stream: that one only)
	$(BIN)/python -m $(if $(BENCH),bench.$(BENCH),bench $(if $(PEERS),--peers $(PEERS)) --write bench/results.md) $(ARGS)

mutants: $(VENV)/.installed-dev ## measure how many small faults the tests notice (ARGS="--rooms scene --sample 10")
	MUTANTS_PYTHON=$(abspath $(BIN))/python $(UV) run --quiet --no-project --python $(BIN)/python \
		--with cosmic-ray==$(COSMIC_RAY) python tools/mutants.py $(ARGS)

docs: $(VENV)/.installed-dev ## write the pages of docs/ that are generated from the source
	$(BIN)/python -m tools.docs_pages docs

# zensical does not count griffe's warnings, which are about docstrings.
docs-site: docs $(SITE_VENV)/.installed ## build the documentation site into out/site; a warning is an error
	@mkdir -p out
	@$(SITE_ENV) $(SITE_VENV)/bin/zensical build --strict --clean >out/site.log 2>&1; code=$$?; cat out/site.log; \
		test $$code -eq 0 && ! grep -q '^griffe: ' out/site.log

docs-serve: docs $(SITE_VENV)/.installed ## serve the site on http://127.0.0.1:8008, built again on each change
	$(SITE_ENV) $(SITE_VENV)/bin/zensical serve --dev-addr 127.0.0.1:8008

generate: $(VENV)/.tools ## write the protobuf classes from protos/ (needs Python 3.11 or 3.12)
	$(UV) run --quiet --no-project --python $(BIN)/python --with grpcio-tools==$(GRPCIO_TOOLS) --with "setuptools<80" \
		python protos/generate.py $(ARGS)

# The types of messages, in one definition with the server's. The build removes types, so it does not need them.
$(WEB)/src/protocol.ts: tools/page_types.py gateway/adapters/viewer/messages.py client/scenegate/messages/controls.py | $(VENV)/.installed-dev
	$(BIN)/python -m tools.page_types $@

check-web: $(WEB)/node_modules/.package-lock.json $(WEB)/src/protocol.ts ## lint, format, types and unit tests of the page (needs node 20)
	cd $(WEB) && npm run --silent check

web: $(WEB)/node_modules/.package-lock.json ## build the page of the browser view (needs node 20)
	cd $(WEB) && npm run build

$(WEB)/node_modules/.package-lock.json: $(WEB)/package-lock.json
	cd $(WEB) && npm ci --no-audit --no-fund

# No index names get into the locks: --no-header, and no --emit-index-url. The client is installed from client/.
COMPILE := $(UV) pip compile pyproject.toml --extra draco --no-emit-package scenegate-client --quiet --universal --python-version 3.11 --generate-hashes --no-header

lock: $(VENV)/.tools ## resolve the locks again (ARGS="--upgrade" for newer versions)
	$(COMPILE) $(ARGS) -o tools/locks/requirements.lock
	$(COMPILE) $(ARGS) --group dev -c tools/locks/requirements.lock -o tools/locks/requirements-dev.lock
	$(UV) pip compile $(ARGS) --quiet --universal --python-version 3.11 --generate-hashes --no-header \
		--group tools -c tools/locks/requirements-dev.lock -o tools/locks/requirements-tools.lock
	$(UV) pip compile $(ARGS) --quiet --universal --python-version 3.11 --generate-hashes --no-header \
		--group site -o tools/locks/requirements-site.lock

clean: ## remove what the recipes made
	rm -rf $(VENV) $(SITE_VENV) .venv-lowest out/site out/site.log .cache .ci-cache .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis build dist
	find gateway renderers client tests bench examples tools -name __pycache__ -type d -prune -exec rm -rf {} +

$(VENV)/.made:
	@test -n "$(PYTHON)" || { echo "No Python found; Scenegate needs 3.11 to 3.14 (make PYTHON=/path/to/python3)."; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 15))' || { \
		echo "$$($(PYTHON) --version) is not supported; Scenegate needs 3.11 to 3.14 (make PYTHON=/path/to/python3)."; exit 1; }
	@$(PYTHON) -m venv $(VENV) || { \
		echo "$(PYTHON) cannot make virtual environments (on Debian and Ubuntu: apt install python3-venv)."; exit 1; }
	@touch $@

$(VENV)/.tools: tools/locks/requirements-tools.lock | $(VENV)/.made
	@echo "Setting up $(VENV) ..."
	@$(PIP) install --quiet --require-hashes -r tools/locks/requirements-tools.lock
	@touch $@

$(VENV)/.installed: tools/locks/requirements.lock pyproject.toml client/pyproject.toml | $(VENV)/.tools
	@$(call install,--require-hashes -r tools/locks/requirements.lock)
	@$(call install,--no-deps --no-build-isolation --editable ./client --editable .)
	@$(BIN)/python -m compileall -q client/scenegate gateway renderers
	@$(BIN)/python -c "$(WRITE_BYTECODE)"
	@touch $@

$(VENV)/.installed-dev: tools/locks/requirements-dev.lock | $(VENV)/.installed
	@$(call install,--require-hashes -r tools/locks/requirements-dev.lock)
	@touch $@

$(SITE_VENV)/.installed: tools/locks/requirements-site.lock | $(VENV)/.tools
	@$(UV) venv --quiet --clear --python $(BIN)/python $(SITE_VENV)
	@$(UV) pip install --quiet --python $(SITE_VENV)/bin/python --require-hashes -r tools/locks/requirements-site.lock
	@touch $@
