# make run   builds what is missing and runs the story: hidden world, estimate, policy, transfer, report
# make test  everything a fresh machine needs, then all tests
# make bench-wire steps per second over HTTP and ZeroMQ, beside bare requests, other servers and the library in process
# make bench rollouts per second beside Pymunk on the same scenes, and how far that is from the machine's limits

VENV := .venv
PYTHON := $(VENV)/bin/python
CARGO := cargo
# Tests run every way the batched kernel can be compiled; one feature set for all of them, so that nothing is built twice.
LEVELS := --features levels

.PHONY: run test test-rust test-python test-clients test-examples lint bench bench-wire bench-hold fuzz fuzz-guided schemathesis \
	deny openapi tasks clean help

help:
	@sed -n 's/^# //p' Makefile

run:
	$(CARGO) build --release --locked
	./target/release/iplw run --out out/quickstart

test: lint test-rust test-examples test-python test-clients

lint:
	$(CARGO) fmt --check
	$(CARGO) clippy --locked $(LEVELS) --all-targets -- -D warnings

test-rust:
	$(CARGO) test --locked $(LEVELS)

# Examples print results that can be checked by eye; here they must run.
test-examples:
	$(CARGO) build --locked $(LEVELS) --bin iplw --examples
	$(CARGO) run --locked $(LEVELS) --example ground_and_roll
	IPLW_BIN=target/debug/iplw bash examples/curl/smoke.sh
	IPLW_BIN=target/debug/iplw bash examples/node/smoke.sh

test-python: $(VENV)/.installed
	$(CARGO) build --locked $(LEVELS) --bin iplw --examples
	cd clients/python && IPLW_BIN=$(CURDIR)/target/debug/iplw ../../$(PYTHON) -m pytest -q
	cd clients/python && ../../$(PYTHON) -m mypy

# (With the examples, as elsewhere: by itself the binary has other features of its dependencies and is built anew.)
# Clients made from the OpenAPI document by others' generators, and the document held against the server.
test-clients: $(VENV)/.generators clients/generated/node_modules/.installed
	$(CARGO) build --locked $(LEVELS) --bin iplw --examples
	cd clients/generated && IPLW_BIN=$(CURDIR)/target/debug/iplw ../../$(PYTHON) -m pytest -q

$(VENV)/.generators: clients/generated/requirements.txt $(VENV)/.installed
	$(PYTHON) -m pip install --quiet --disable-pip-version-check -r clients/generated/requirements.txt
	touch $@

clients/generated/node_modules/.installed: clients/generated/package-lock.json
	if command -v npm >/dev/null; then cd clients/generated && npm ci --silent --no-audit --no-fund; fi
	mkdir -p clients/generated/node_modules && touch $@

$(VENV)/.installed: clients/python/pyproject.toml
	python3 -m venv $(VENV)
	$(PYTHON) -m pip install --quiet --disable-pip-version-check -e 'clients/python[test,learn,pandas,zmq]'
	touch $@

bench: $(VENV)/.installed
	$(PYTHON) -m pip install --quiet --disable-pip-version-check pymunk==7.3.1 Box2D
	PYTHON=$(PYTHON) sh benches/compare.sh

# The others have an environment of their own: their requirements are not ours.
bench-wire: $(VENV)/.installed
	$(CARGO) build --release --locked --bin iplw --example echo --example in_process
	test -d $(VENV)-peers || python3 -m venv $(VENV)-peers
	$(VENV)-peers/bin/python -m pip install --quiet --disable-pip-version-check \
		openenv-core==0.3.0 dm_env_rpc==1.1.7 flask==3.1.3 requests numpy
	$(PYTHON) benches/wire.py --peers $(VENV)-peers/bin/python

# Every fuzz target as often as it is to stand (hours); RUNS=100000 makes it short. Where `cargo fuzz` and a nightly compiler
# are, each is then fuzzed by what it reaches, too, for GUIDED seconds.
FUZZED := zmtp msgpack bodies requests trials tracks weights tokens limits
RUNS := long
SCENES := 1000000
GUIDED := 600
fuzz:
	for t in $(FUZZED); do \
		FUZZ_RUNS=$(RUNS) $(CARGO) test --locked $(LEVELS) --test fuzz -- --exact $$t --nocapture || exit 1; done
	FUZZ_SCENES=$(SCENES) $(CARGO) test --locked $(LEVELS) --test physics -- mutated_scenes --nocapture
	if $(CARGO) +nightly fuzz --version 2>/dev/null; then $(MAKE) fuzz-guided; fi

fuzz-guided:
	for t in $(FUZZED) scene; do $(CARGO) +nightly fuzz run --sanitizer none $$t -- \
		-max_total_time=$(GUIDED) -timeout=10 -malloc_limit_mb=64 -max_len=65536 || exit 1; done

# The server held against its document, deeply: EXAMPLES an operation and for states that follow from each other.
EXAMPLES := 200
schemathesis: $(VENV)/.generators
	$(CARGO) build --locked $(LEVELS) --bin iplw --examples
	cd clients/generated && EXAMPLES=$(EXAMPLES) IPLW_BIN=$(CURDIR)/target/debug/iplw \
		../../$(PYTHON) -m pytest -q -s -k document_says

# Licences, sources and known faults of what the program is built of; the last needs the advisories' database.
deny:
	$(CARGO) deny --version || $(CARGO) install cargo-deny --locked
	$(CARGO) deny check licenses bans sources
	$(CARGO) deny check advisories

# A thousand sessions, 64 clients at once; the figure in the README is with SECONDS=300.
SECONDS := 20
bench-hold: $(VENV)/.installed
	$(CARGO) build --release --locked --bin iplw
	$(PYTHON) benches/hold.py --seconds $(SECONDS)

openapi:
	$(CARGO) build --locked $(LEVELS) --bin iplw --examples
	./target/debug/iplw openapi > openapi/openapi.json.new && mv openapi/openapi.json.new openapi/openapi.json
	python3 clients/python/generate.py

# Searches the built-in tasks anew; only when physics or selection changed.
tasks:
	$(CARGO) build --release --locked
	for f in src/task/families/*.certified.json; do \
		./target/release/iplw tasks $$(basename $$f .certified.json) --certify > $$f.new && mv $$f.new $$f; done

clean:
	rm -rf out $(VENV) $(VENV)-peers clients/generated/node_modules clients/generated/out
