# make run   builds the program and runs the whole workflow: hidden world, estimate, policy, transfer, report
# make test  installs what is missing, then runs all checks and tests
# make verify runs the statistical tests with all their cases, 400 hidden worlds of each matrix, and all examples, hours; `make test` runs a few of each
# make examples-extra runs the examples for Optuna, sbi, ArviZ, TensorBoard and stable-baselines3, and the Colab notebook; prints their results and times
# make docs  the documentation site, out/site
# make figures renders docs/benchmarks from its stored results; RERUN=NAME measures one anew
# make bench-wire measures steps per second over HTTP and ZeroMQ against bare requests, other servers and the library in process
# make damage truncates and flips bits of a data directory 1000 times each; the store must never return wrong data
# make kill  kills a server at 100 random moments of a workload; no acknowledged write may be lost
# make harden measures the server under floods, disconnects and slow clients
# make attack measures what the dearest requests, jobs and floods cost the server and its other clients; fails if that is too much
# make soak  runs a mixed load for an hour (MINUTES=60) and reports memory growth
# make gpu-kernel builds the kernel for graphics processors, gpu/kernel.ptx, and checks it with NVIDIA's assembler; needs Rust's nightly toolchain with rust-src
# make release builds and tests the published files: wheel, sources, licences, bill of materials, container image
# make bench measures rollouts per second against Pymunk on the same scenes and against the machine's limits

VENV := .venv
PYTHON := $(VENV)/bin/python
CARGO := cargo
# `make test` compiles everything once: incremental compilation only adds work, and makes the program 1.4 times slower.
ifneq ($(filter test,$(MAKECMDGOALS))$(CI),)
export CARGO_INCREMENTAL := 0
endif
# Tests run every instruction-set level of the batched kernel. All targets use one feature set, so that nothing is built twice.
LEVELS := --features levels

.PHONY: run test environments test-beside verify matrices test-rust test-python test-clients test-examples lint damage kill bench bench-wire bench-hold harden attack soak fuzz \
	test-openenv test-docs examples-extra docs figures diagrams fuzz-guided schemathesis deny openapi tasks web web-check test-web licences release clean help gpu-kernel

help:
	@sed -n 's/^# \(make .*\)/\1/p' Makefile

run:
	$(CARGO) build --release --locked
	./target/release/iplw run --out out/quickstart

# First what keeps all cores busy. The rest runs side by side, since the browser and servers wait for each other half the time; all
# packages are installed before, one environment at a time.
test: lint test-rust
	$(CARGO) build --locked $(LEVELS) --bin iplw --examples
	$(MAKE) environments
	$(MAKE) --jobs 3 --output-sync=line test-python test-web test-beside

environments: $(VENV)/.installed $(VENV)/.generators $(VENV)/.browser $(VENV)-docs/.installed $(VENV)-openenv/.installed \
	clients/generated/node_modules/.installed
	sh web/browser/chromium.sh

# One after the other.
test-beside:
	$(MAKE) test-examples
	$(MAKE) test-clients
	$(MAKE) test-openenv
	$(MAKE) test-docs

lint:
	python3 release/licences.py --check
	$(CARGO) fmt --check
	$(CARGO) clippy --locked $(LEVELS) --all-targets -- -D warnings

# The library's own tests need no further instruction-set levels, the others compile the library with all of them.
test-rust:
	$(CARGO) test --locked --lib
	$(CARGO) test --locked $(LEVELS) --bins --test '*'
	$(CARGO) test --locked $(LEVELS) --doc

# The statistical tests (coverage of intervals, matrices of hidden worlds) with all their cases.
verify: matrices examples-extra
	ALL_CASES=1 $(CARGO) test --locked $(LEVELS) --test learning

# 400 worlds of each matrix: clean, with dirt by trial, with dirt that trials share. An interrupted run resumes.
matrices:
	$(CARGO) build --release --locked --example hidden_effects --example hidden_recordings
	./target/release/examples/hidden_effects --worlds 200 --seed 3 --once --threads 2 --most-wrong 0.02 --out out/matrices/clean/table.md
	./target/release/examples/hidden_recordings --worlds 400 --seed 3 --once --threads 2 --most-wrong 0.03 --out out/matrices/trials/table.md
	./target/release/examples/hidden_recordings --worlds 400 --seed 3 --once --threads 2 --most-wrong 0.03 --shared --out out/matrices/shared/table.md

# Examples print results for inspection; this target checks that they run.
test-examples:
	$(CARGO) build --locked $(LEVELS) --bin iplw --examples
	$(CARGO) run --locked $(LEVELS) --example ground_and_roll
	IPLW_BIN=target/debug/iplw bash examples/curl/smoke.sh
	IPLW_BIN=target/debug/iplw bash examples/node/smoke.sh

# Examples whose packages are too large for every test run (6 GB, with PyTorch and its CUDA), in an environment of their own.
examples-extra: $(VENV)-examples/.installed
	$(CARGO) build --locked $(LEVELS) --bin iplw --examples
	cd clients/python && IPLW_BIN=$(CURDIR)/target/debug/iplw WANDB_MODE=offline ../../$(VENV)-examples/bin/python -m pytest -q -s -rs \
		--durations=0 --durations-min=1 tests/test_examples.py tests/test_notebooks.py -k "short or optuna or sbi or arviz or log or attempts or colab"

$(VENV)-examples/.installed: examples/python/requirements.txt pyproject.toml clients/python/develop.py
	python3 -m venv $(VENV)-examples
	$(VENV)-examples/bin/python -m pip install --quiet --disable-pip-version-check -r examples/python/requirements.txt
	$(VENV)-examples/bin/python clients/python/develop.py notebook
	touch $@

# A file's tests stay in one process; each process has its own server.
test-python: $(VENV)/.installed
	$(CARGO) build --locked $(LEVELS) --bin iplw --examples
	cd clients/python && IPLW_BIN=$(CURDIR)/target/debug/iplw ../../$(PYTHON) -m pytest -q -n auto --dist loadfile
	$(PYTHON) -m mypy
	for v in 3.10 3.13; do $(PYTHON) -m mypy --python-version $$v clients/python/src || exit 1; done

# The binary is always built together with the examples: built alone, its dependencies have other features and compile again.
# Tests clients generated from the OpenAPI document by third-party generators, and the server against the document.
test-clients: $(VENV)/.generators clients/generated/node_modules/.installed
	$(CARGO) build --locked $(LEVELS) --bin iplw --examples
	cd clients/generated && IPLW_BIN=$(CURDIR)/target/debug/iplw ../../$(PYTHON) -m pytest -q

$(VENV)/.generators: clients/generated/requirements.txt $(VENV)/.installed
	$(PYTHON) -m pip install --quiet --disable-pip-version-check -r clients/generated/requirements.txt
	touch $@

clients/generated/node_modules/.installed: clients/generated/package-lock.json
	if command -v npm >/dev/null; then cd clients/generated && npm ci --silent --no-audit --no-fund; fi
	mkdir -p clients/generated/node_modules && touch $@

$(VENV)/.installed: pyproject.toml clients/python/develop.py
	python3 -m venv $(VENV)
	$(PYTHON) clients/python/develop.py test learn notebook zmq ray
	touch $@

# The reference pages, out/site: from docstrings, the OpenAPI document, what the commands say, and docs/. Any warning, link that
# leads nowhere or thing loaded from elsewhere fails.
docs: $(VENV)-docs/.installed
	$(CARGO) build --locked $(LEVELS) --bin iplw --examples
	$(VENV)-docs/bin/python docs/site/build.py --bin target/debug/iplw

test-docs: docs
	cd docs/site && ../../$(VENV)-docs/bin/python -m pytest -q
	cd docs/site && ../../$(VENV)-docs/bin/python -m mypy

# Renders docs/benchmarks/*.md from docs/benchmarks/results; `make figures RERUN=NAME` runs the stored command of one first.
figures:
	python3 docs/benchmarks/render.py $(if $(RERUN),--rerun $(RERUN))

# Draws what diagrams have changed (npm, Chromium).
diagrams: $(VENV)-docs/.installed
	$(VENV)-docs/bin/python docs/site/diagrams.py

$(VENV)-docs/.installed: docs/site/requirements.txt $(VENV)/.installed
	$(PYTHON) -m pip install --quiet --disable-pip-version-check 'uv>=0.9'
	$(PYTHON) -m uv venv --quiet --allow-existing --python $(PYTHON) $(VENV)-docs
	$(PYTHON) -m uv pip install --quiet --python $(VENV)-docs/bin/python -r docs/site/requirements.txt
	touch $@

# OpenEnv's own client and server, in an environment of their own: they bring gradio, pandas and fastmcp. uv installs that in
# seconds where pip takes a minute.
test-openenv: $(VENV)-openenv/.installed
	$(CARGO) build --locked $(LEVELS) --bin iplw --examples
	IPLW_BIN=$(CURDIR)/target/debug/iplw $(VENV)-openenv/bin/python -m pytest -q clients/openenv
	$(VENV)-openenv/bin/python -m mypy clients/python/src/iplw/openenv clients/openenv

$(VENV)-openenv/.installed: pyproject.toml clients/openenv/requirements.txt $(VENV)/.installed
	$(PYTHON) -m pip install --quiet --disable-pip-version-check 'uv>=0.9'
	$(PYTHON) -m uv venv --quiet --seed --allow-existing --python $(PYTHON) $(VENV)-openenv
	$(PYTHON) -m uv pip install --quiet --python $(VENV)-openenv/bin/python -r clients/openenv/requirements.txt
	$(VENV)-openenv/bin/python clients/python/develop.py openenv
	touch $@

damage:
	$(CARGO) test --locked $(LEVELS) --lib damage::directory_damaged_a_thousand -- --ignored --nocapture

kill:
	$(CARGO) test --locked $(LEVELS) --test serving kill::acknowledged_writes_survive_a_hundred -- --ignored --nocapture

bench: $(VENV)/.installed
	$(PYTHON) -m pip install --quiet --disable-pip-version-check pymunk==7.3.1 Box2D
	PYTHON=$(PYTHON) sh benches/compare.sh

# The compared servers have a separate environment, since their requirements conflict.
bench-wire: $(VENV)/.installed
	$(CARGO) build --release --locked --bin iplw --example echo --example in_process
	test -d $(VENV)-peers || python3 -m venv $(VENV)-peers
	$(VENV)-peers/bin/python -m pip install --quiet --disable-pip-version-check \
		openenv-core==0.3.0 dm_env_rpc==1.1.7 flask==3.1.3 requests numpy
	$(PYTHON) benches/wire.py --peers $(VENV)-peers/bin/python

# Runs every fuzz target in full (hours); RUNS=100000 is shorter. If `cargo fuzz` and a nightly compiler are installed, coverage-guided
# fuzzing of each target follows for GUIDED seconds.
FUZZED := zmtp msgpack bodies requests trials tracks weights tokens limits
RUNS := long
SCENES := 1000000
GUIDED := 600
fuzz:
	for t in $(FUZZED); do \
		FUZZ_RUNS=$(RUNS) $(CARGO) test --locked --profile checked --test fuzz -- --exact $$t --nocapture || exit 1; done
	FUZZ_SCENES=$(SCENES) $(CARGO) test --locked --profile checked --test physics -- mutated_scenes --nocapture
	if $(CARGO) +nightly fuzz --version 2>/dev/null; then $(MAKE) fuzz-guided; fi

fuzz-guided:
	for t in $(FUZZED) scene; do $(CARGO) +nightly fuzz run --sanitizer none $$t -- \
		-max_total_time=$(GUIDED) -timeout=10 -malloc_limit_mb=64 -max_len=65536 || exit 1; done

# Tests the server against its OpenAPI document with EXAMPLES requests an operation and with sequences of operations.
EXAMPLES := 200
schemathesis: $(VENV)/.generators
	$(CARGO) build --locked $(LEVELS) --bin iplw --examples
	cd clients/generated && EXAMPLES=$(EXAMPLES) IPLW_BIN=$(CURDIR)/target/debug/iplw \
		../../$(PYTHON) -m pytest -q -s -k conforms_to_document

# Checks licences, sources and security advisories of the dependencies; the last needs the advisory database.
deny:
	$(CARGO) deny --version || $(CARGO) install cargo-deny --locked
	$(CARGO) deny check licenses bans sources
	$(CARGO) deny check advisories

# Writes THIRD-PARTY.txt, the dependencies' licences; run it after a change of Cargo.lock or of the page's packages.
licences:
	python3 release/licences.py

# Builds and tests wheel, sources, bill of materials and container image: release/release.py (FINAL=1 for a publication).
# A publication first runs the statistical tests in full.
release: $(VENV)-release/.installed
	$(if $(FINAL),$(MAKE) verify)
	$(VENV)-release/bin/python release/release.py

$(VENV)-release/.installed: release/requirements.txt
	python3 -m venv $(VENV)-release
	$(VENV)-release/bin/python -m pip install --quiet --disable-pip-version-check -r release/requirements.txt
	touch $@

# A thousand sessions, 64 clients at once; the published figure uses SECONDS=300.
SECONDS := 20
bench-hold: $(VENV)/.installed
	$(CARGO) build --release --locked --bin iplw
	$(PYTHON) benches/hold.py --seconds $(SECONDS)

# The figures of SECURITY.md.
harden:
	$(CARGO) build --release --locked --bin iplw
	python3 benches/harden.py

attack:
	$(CARGO) build --release --locked --bin iplw
	python3 benches/attack.py

# A mixed load for MINUTES; reports memory growth.
MINUTES := 60
soak:
	$(CARGO) build --release --locked --bin iplw
	python3 benches/soak.py --minutes $(MINUTES)

# After changes to the sources of the batched engine, of which the kernel is made.
gpu-kernel: $(VENV)-gpu/.installed
	bash gpu/build.sh
	$(VENV)-gpu/bin/python gpu/check.py
	SIGN_KERNEL=1 $(CARGO) test --locked $(LEVELS) --test program the_kernel_is_built_from_the_current_sources

$(VENV)-gpu/.installed:
	python3 -m venv $(VENV)-gpu
	$(VENV)-gpu/bin/pip install --quiet nvidia-cuda-nvcc-cu12==12.9.86
	touch $@

openapi:
	$(CARGO) build --locked $(LEVELS) --bin iplw --examples
	./target/debug/iplw openapi > openapi/openapi.json.new && mv openapi/openapi.json.new openapi/openapi.json
	python3 clients/python/generate.py

# Builds the web page. Its bundle is committed, so that building the program needs no Node.
web: web/node_modules/.installed
	cd web && npm run --silent types && npm run --silent check && npm run --silent build

# Fails if the committed bundle differs from a fresh build.
web-check: web/node_modules/.installed
	cd web && npm run --silent check && npm test --silent && node build.mjs --check
	cd web && npx --no-install openapi-typescript ../openapi/openapi.json --output out/schema.d.ts >/dev/null 2>&1 && \
		cmp out/schema.d.ts src/api/schema.d.ts

# Browser tests in Debian's Chromium, which is installed if permitted.
test-web: $(VENV)/.browser
	$(CARGO) build --locked $(LEVELS) --bin iplw --examples
	IPLW_BIN=$(CURDIR)/target/debug/iplw sh web/browser/run.sh $(CURDIR)/$(PYTHON)

$(VENV)/.browser: web/browser/requirements.txt $(VENV)/.installed
	$(PYTHON) -m pip install --quiet --disable-pip-version-check -r web/browser/requirements.txt
	touch $@

web/node_modules/.installed: web/package-lock.json
	cd web && npm ci --silent --no-audit --no-fund
	touch $@

# Certifies the built-in tasks anew; needed only after a change of physics or selection.
tasks:
	$(CARGO) build --release --locked
	for f in src/task/families/*.toml src/task/families/*/*.toml examples/families/*.toml; do ./target/release/iplw tasks check $$f || exit 1; done

clean:
	rm -rf out $(VENV) $(VENV)-peers $(VENV)-openenv $(VENV)-docs $(VENV)-examples $(VENV)-release dist clients/generated/node_modules \
		clients/generated/out web/node_modules web/out
