# Everything a fresh clone needs: `make demo` and `make test` do their own set-up.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check
# PyTorch is kept if it is installed already. TORCH_INDEX=URL takes it from another index (small CPU wheels).
TORCH_INDEX ?=
# The demo: room and its seed.
SCENE ?= living_room
SEED ?= 7
FRAMES ?= 300
SIZE ?= 480x360
DEMO := runs/demo

.PHONY: demo test test-slow lint typecheck bench weights clean help
help:
	@echo "make demo       set up, render a room, map it, label it, evaluate it; leaves everything in $(DEMO)"
	@echo "make test       set up and run the tests (make test-slow: the long ones)"
	@echo "make lint       ruff;  make typecheck  pyright"
	@echo "make weights    render training rooms and train the shipped DS-Net again"

$(VENV)/bin/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "dsmap needs Python 3.11 or newer; $(PYTHON) is $$($(PYTHON) -V 2>&1). Try: make PYTHON=python3.11"; exit 2; }
	$(PYTHON) -m venv $(VENV)

# A torch that is there is kept; without one, pip gets it from TORCH_INDEX or the usual index.
$(VENV)/.torch: | $(VENV)/bin/python
	@$(BIN)/python -c 'import torch' 2>/dev/null || \
		$(PIP) install -q -c constraints.txt $(if $(TORCH_INDEX),--index-url $(TORCH_INDEX)) torch
	@touch $@

$(VENV)/.demo: pyproject.toml constraints.txt | $(VENV)/.torch
	@echo "installing dsmap into $(VENV) (once)"
	@$(PIP) install -q -c constraints.txt -e '.[sim,dsnet]'
	@touch $@

$(VENV)/.dev: pyproject.toml constraints.txt | $(VENV)/.torch
	@echo "installing dsmap and its tests into $(VENV) (once)"
	@$(PIP) install -q -c constraints.txt -e '.[sim,dsnet,train,view,dev]'
	@touch $@ $(VENV)/.demo

demo: $(VENV)/.demo
	$(BIN)/dsmap render-scene $(DEMO)/sequence --scene $(SCENE) --seed $(SEED) --frames $(FRAMES) --size $(SIZE) --noise kinect --overwrite
	$(BIN)/dsmap map $(DEMO)/sequence --out $(DEMO)/run --overwrite
	$(BIN)/dsmap evaluate $(DEMO)/run --reference $(DEMO)/sequence
	@echo "pictures: $$(ls $(DEMO)/run/pictures/*.png | tr '\n' ' ')"

test: $(VENV)/.dev
	$(BIN)/python -m pytest

test-slow: $(VENV)/.dev
	$(BIN)/python -m pytest -m slow

lint: $(VENV)/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

# pyright does not see through the package mapping of an editable install: a folder of links shows it one package.
typecheck: $(VENV)/.dev
	@rm -rf build/typing && mkdir -p build/typing/dsmap
	@ln -s $(CURDIR)/src/dsmap/* build/typing/dsmap/
	@for part in kernels fusion dsnet sim_scenes tools; do ln -s $(CURDIR)/$$part build/typing/dsmap/$$part; done
	$(BIN)/pyright

# Renders 240 rooms (seeds 1000..1239; the demo and the evaluations use 0..99) and 10 rooms for validation
# (900..909), then trains DS-Net by the recipe `rooms`, small images first. About an hour
# and a half on 2 free cores. The loop and the recipe go on where they stopped.
ROOMS := runs/rooms
weights: $(VENV)/.demo
	@for seed in $$(seq 900 909) $$(seq 1000 1239); do \
		[ $$seed -lt 1000 ] && set=val || set=train; \
		[ $$((seed % 2)) = 0 ] && scene=living_room || scene=bedroom; \
		[ -e $(ROOMS)/$$set/$$seed/scene.json ] || $(BIN)/dsmap render-scene $(ROOMS)/$$set/$$seed \
			--scene $$scene --seed $$seed --frames 20 --size 320x240 --path views --overwrite || exit; \
	done
	$(BIN)/dsmap train --recipe rooms --places rooms=$(ROOMS) --out runs/dsnet --resume
	cp runs/dsnet/best.safetensors dsnet/weights/dsnet.safetensors

clean:
	rm -rf build runs/demo *.egg-info src/*.egg-info .pytest_cache .ruff_cache
