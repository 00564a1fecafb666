# make run   builds what is missing and runs the story: hidden world, estimate, policy, transfer, report
# make test  everything a fresh machine needs, then all tests
# make bench rollouts per second beside Pymunk on the same scenes, and how far that is from the machine's limits

VENV := .venv
PYTHON := $(VENV)/bin/python
CARGO := cargo

.PHONY: run test test-rust test-python test-examples lint bench openapi tasks clean help

help:
	@sed -n 's/^# //p' Makefile

run:
	$(CARGO) build --release --locked
	./target/release/iplw run --out out/quickstart

test: lint test-rust test-examples test-python

lint:
	$(CARGO) fmt --check
	$(CARGO) clippy --locked --all-targets -- -D warnings

test-rust:
	$(CARGO) test --locked

# Examples print results that can be checked by eye; here they must run.
test-examples:
	$(CARGO) build --locked --bin iplw --examples
	$(CARGO) run --locked --example ground_and_roll
	IPLW_BIN=target/debug/iplw bash examples/curl/smoke.sh
	IPLW_BIN=target/debug/iplw bash examples/node/smoke.sh

test-python: $(VENV)/.installed
	$(CARGO) build --locked --bin iplw --examples
	cd clients/python && IPLW_BIN=$(CURDIR)/target/debug/iplw ../../$(PYTHON) -m pytest -q
	cd clients/python && ../../$(PYTHON) -m mypy

$(VENV)/.installed: clients/python/pyproject.toml
	python3 -m venv $(VENV)
	$(PYTHON) -m pip install --quiet --disable-pip-version-check -e 'clients/python[test,learn,pandas]'
	touch $@

bench: $(VENV)/.installed
	$(PYTHON) -m pip install --quiet --disable-pip-version-check pymunk==7.3.1 Box2D
	PYTHON=$(PYTHON) sh benches/compare.sh

openapi:
	$(CARGO) run --locked --bin iplw -- openapi > openapi/openapi.json.new && mv openapi/openapi.json.new openapi/openapi.json

# Searches the built-in tasks anew; only when physics or selection changed.
tasks:
	$(CARGO) build --release --locked
	for f in bowling basketball; do ./target/release/iplw tasks $$f --certify > $$f.new && mv $$f.new src/task/$$f.certified.json; done

clean:
	rm -rf out $(VENV)
