#!/usr/bin/env bash
# Runs the Node client against a private server. IPLW_BIN: path of the binary, default target/debug/iplw.
set -euo pipefail
cd "$(dirname "$0")"

binary=$(cd ../.. && realpath "${IPLW_BIN:-target/debug/iplw}")
npm ci --silent --no-audit --no-fund
coproc server { exec "$binary" serve --http 127.0.0.1:0 --zmq 'tcp://127.0.0.1:*' --exit-with-stdin; }
trap 'kill "$server_PID" 2>/dev/null || true' EXIT
read -r _ <&"${server[0]}"
read -r _ _ address <&"${server[0]}"
node client.mjs "$address"
