#!/usr/bin/env bash
# Calls reset, step, set_latents, rollout and render on every default world, using only curl
# (and python3 to parse JSON).
#
#   examples/curl/smoke.sh [base-url]
#
# Without a URL it starts a private server and stops it at the end. IPLW_BIN: path of the binary, default
# target/release/iplw or target/debug/iplw. Exits with 1 at the first failed check.
set -euo pipefail
cd "$(dirname "$0")/../.."

work=$(mktemp -d)
server=
cleanup() {
    if [ -n "$server" ]; then
        kill "$server" 2>/dev/null || true
        wait "$server" 2>/dev/null || true
    fi
    rm -rf "$work"
}
trap cleanup EXIT

fail() {
    echo "failed: $*" >&2
    exit 1
}

if [ $# -ge 1 ]; then
    url=${1%/}
else
    bin=${IPLW_BIN:-}
    for candidate in target/release/iplw target/debug/iplw; do
        if [ -z "$bin" ] && [ -x "$candidate" ]; then bin=$candidate; fi
    done
    [ -n "$bin" ] || fail "no iplw binary; build one (cargo build --release) or set IPLW_BIN"
    "$bin" serve --http 127.0.0.1:0 >"$work/out" 2>"$work/err" &
    server=$!
    url=
    for _ in $(seq 300); do
        url=$(sed -n 's/^listening on //p' "$work/out")
        [ -n "$url" ] && break
        kill -0 "$server" 2>/dev/null || fail "the server ended: $(cat "$work/err")"
        sleep 0.1
    done
    [ -n "$url" ] || fail "the server did not print its address"
fi

# call STATUS METHOD PATH [BODY]: writes the response body to $work/body, and fails unless the status is STATUS.
call() {
    local expected=$1 method=$2 path=$3 got
    local data=()
    if [ $# -ge 4 ]; then data=(-H 'Content-Type: application/json' -d "$4"); fi
    got=$(curl -sS -o "$work/body" -w '%{http_code}' -X "$method" "${data[@]}" "$url$path") || fail "$method $path: no response"
    [ "$got" = "$expected" ] || fail "$method $path: $got instead of $expected: $(head -c 400 "$work/body")"
}

# json EXPRESSION: evaluates a Python expression of the last response `a`.
json() {
    python3 -c 'import json, sys
a = json.load(open(sys.argv[1]))
v = eval(sys.argv[2])
print(json.dumps(v) if isinstance(v, (bool, list, dict, type(None))) else v)' "$work/body" "$1"
}

# expect EXPRESSION: fails unless the expression is true.
expect() {
    [ "$(json "$1")" = true ] || fail "expected $1 in $(head -c 400 "$work/body")"
}

call 200 GET /healthz
call 200 GET /readyz

for family in bowling basketball; do
    for kind in sim real; do
        id=$family-$kind
        world=/v1/worlds/$id

        call 200 GET "$world"
        dimension=$(json 'a["action_space"]["dimension"]')
        features=$(json 'len(a["observation_space"]["names"])')
        before=$(json 'a["interactions"]')
        if [ $kind = real ]; then
            expect 'a["sealed"] and a["latents"] is None and a["effects"] is None'
        fi

        call 200 POST "$world/reset" '{"seed": 1}'
        task=$(json 'a["info"]["task"]')
        expect "len(a['observation']) == $features and all(0 <= v <= 1 for v in a['observation'])"

        # Discrete actions in order until one is valid; invalid ones do not count as attempts.
        for index in $(seq 0 997 39000); do
            call 200 POST "$world/step" "{\"action\": $index}"
            expect 'a["truncated"] is False and a["terminated"] == a["info"]["valid"]'
            [ "$(json 'a["terminated"]')" = true ] && break
        done
        expect "a['info']['valid'] and a['info']['interactions'] == $before + 1"
        expect 'a["reward"] == (1 if a["info"]["solved"] else 0)'
        reward=$(json 'a["reward"]')
        call 409 POST "$world/step" "{\"action\": $index}"

        if [ $kind = real ]; then
            call 403 POST "$world/set_latents" '{"friction": 0.5}'
            expect 'a["type"].endswith("/sealed")'
        else
            call 200 POST "$world/set_latents" '{"friction": 0.5, "restitution": 0.4}'
            expect 'a["latents"]["friction"] == 0.5 and a["latents"]["restitution"] == 0.4'
            call 422 POST "$world/set_latents" '{"friction": -1}'
            expect 'a["field"] == "friction"'
        fi

        centre=$(python3 -c "print([0.5] * $dimension)")
        call 200 POST "$world/rollout" "{\"actions\": [$index, $centre, 1, 2, 3], \"trajectories\": true}"
        expect "len(a['results']) == 5 and a['task'] == '$task' and a['results'][0]['valid']"
        expect 'all(len(b["x"]) == len(a["results"][0]["t"]) for b in a["results"][0]["bodies"].values())'
        valid=$(json 'sum(r["valid"] for r in a["results"])')
        solved=$(json 'sum(r["solved"] is True for r in a["results"])')
        expect "a['interactions'] == $before + 1 + $valid"

        call 200 GET "$world/render?format=png&width=256"
        [ "$(head -c 4 "$work/body" | tail -c 3)" = PNG ] || fail "the picture of $id is not a PNG"
        call 200 GET "$world/render?format=svg&view=filmstrip&action=$index"
        grep -q '<svg' "$work/body" || fail "the film of $id is not an SVG"
        call 200 GET "$world"
        expect "a['interactions'] == $before + 2 + $valid"

        echo "$id: $task, action $index, reward $reward; rollout of 5: $valid valid, $solved solved;" \
            "$(json 'a["interactions"]') interactions"
    done
done
echo "all default worlds play"
