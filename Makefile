# One virtual environment for everything, made when it is first needed and made anew when
# pyproject.toml or constraints.txt change. Nothing outside this folder is touched.

# Say `make PYTHON=...` to choose an interpreter; else the first on the path that is new enough.
PYTHON ?=
CANDIDATES = $(if $(PYTHON),$(PYTHON),python3 python3.13 python3.12 python3.11)

BIN = .venv/bin
READY = .venv/ready
LINT_READY = .venv/ready-to-lint

.DEFAULT_GOAL = help
.DELETE_ON_ERROR:
.PHONY: help paper test lint docs format clean

help:  ## this list
	@sed -n 's/^\([a-z]*\):.*## /\1  /p' Makefile | awk '{ printf "  make %-8s", $$1; $$1 = ""; print }'

paper: $(READY)  ## the paper's experiment: figures and tables, in results/paper
	@$(BIN)/python -m scenarios.paper --seed 0 --out results/paper --overwrite

test: $(READY)  ## all tests, the slow ones too
	@$(BIN)/python -m pytest -n auto --dist worksteal

lint: $(LINT_READY)  ## style, format and types, and the prose of pages and code
	@$(BIN)/ruff check
	@$(BIN)/ruff format --check
	@$(BIN)/mypy
	@$(BIN)/python -m tests.prose

docs: $(READY)  ## the documentation as pages for a browser, in docs/_build/html
	@$(BIN)/python -m sphinx -q -W --keep-going docs docs/_build/html
	@echo "The documentation is in docs/_build/html/index.html"

format: $(LINT_READY)  ## put the code into the one format
	@$(BIN)/ruff check --fix-only --quiet
	@$(BIN)/ruff format

clean:  ## remove the environment, results/paper, the built documentation and caches
	@rm -rf .venv build dist results/paper docs/_build docs/_examples docs/gallery .coverage htmlcov .pytest_cache .mypy_cache .ruff_cache .hypothesis
	@find . -name __pycache__ -type d -prune -exec rm -rf {} +

# Exit code 3: too old; 4: no venv. A candidate that does not start at all counts as too old.
define CHECK
import sys
if sys.version_info < (3, 11):
    sys.exit(3)
try:
    import ensurepip, venv
except ImportError:
    sys.exit(4)
endef
export CHECK

$(READY): pyproject.toml constraints.txt
	@chosen=; without_venv=; \
	for candidate in $(CANDIDATES); do \
	    code=0; "$$candidate" -c "$$CHECK" >/dev/null 2>&1 || code=$$?; \
	    if [ $$code = 0 ]; then chosen=$$candidate; break; fi; \
	    if [ $$code = 4 ]; then without_venv="$$without_venv $$candidate"; fi; \
	done; \
	if [ -z "$$chosen" ] && [ -n "$$without_venv" ]; then \
	    echo "This Python cannot make virtual environments ($${without_venv# }): install its venv module" \
	        "(on Debian and Ubuntu the package python3-venv), then run make again." >&2; exit 1; \
	elif [ -z "$$chosen" ]; then \
	    echo "Python 3.11 or newer is needed and was not found (tried: $(strip $(CANDIDATES))): install it with" \
	        "its venv module (on Debian and Ubuntu the packages python3 and python3-venv)," \
	        "or name it with make PYTHON=..." >&2; exit 1; \
	fi; \
	echo "Making .venv with $$("$$chosen" --version) (about a minute)"; \
	"$$chosen" -m venv --clear .venv
	@$(call INSTALL,test)
	@touch $@

$(LINT_READY): $(READY)
	@echo "Adding the tools that check the code to .venv"
	@$(call INSTALL,dev)
	@touch $@

# uv installs in a fifth of the time, where it is there and reaches the packages; else pip does. What is said is shown
# only when it fails. Most modules are never imported: those that are get their byte code then.
define INSTALL
{ command -v uv >/dev/null && uv pip install --quiet --python $(BIN)/python -c constraints.txt -e '.[$(1)]' \
    >.venv/install.log 2>&1; } || \
$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile -c constraints.txt -e '.[$(1)]' \
    >.venv/install.log 2>&1 || { cat .venv/install.log >&2; \
    echo "The packages could not be installed (see above)." >&2; exit 1; }
endef
