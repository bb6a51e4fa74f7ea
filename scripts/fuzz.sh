#!/usr/bin/env bash
# Fuzzes what reads input from outside (tests/fuzz/), guided by coverage, on all processors.
#
#   scripts/fuzz.sh [SECONDS] [TARGET...]    each target for 60 s unless told otherwise; all targets unless some are named
#
# Findings lie in target/fuzz/artifacts/TARGET/, the corpus that grows in target/fuzz/corpus/TARGET/. The exit code is 1
# if anything was found. CONTRIBUTING.md says what to do with a finding.
#
# The address sanitizer is on: it finds reads and writes beyond their memory in unsafe code of dependencies. Without it:
# SANITIZER=none scripts/fuzz.sh. Debug assertions and overflow checks are on in either case. The first build takes about
# ten minutes on two cores.
set -euo pipefail
cd "$(dirname "$0")/.."
source scripts/setup.sh

TARGET_DIR=${CARGO_TARGET_DIR:-target}
TOOLS=$TARGET_DIR/tools
BUILD=$TARGET_DIR/fuzz-build
OUT=target/fuzz
SANITIZER=${SANITIZER:-address}

# Of each target: longest input (bytes), longest time for one (s), most memory (MiB).
declare -A LIMITS=(
    [bags]="8192 10 1024"
    [datagrams]="1400 2 512"
    [drawings]="8192 20 1024"
    [http]="8192 2 512"
    [logs]="16384 20 1024"
    [models]="8192 10 1024"
    [pose_tables]="4096 5 512"
    [ros2_messages]="2048 2 512"
    [ros_messages]="2048 2 512"
    [rosbridge]="4096 5 512"
    [scenarios]="4096 20 1024"
    [served_world]="4096 20 1024"
    [tcpros_headers]="2048 2 512"
    [xml_rpc]="4096 2 512"
)

install_fuzzer() {
    find_rust
    install_packages g++
    cargo +nightly --version >/dev/null 2>&1 || rustup toolchain install nightly --profile minimal
    export PATH="$PWD/$TOOLS/bin:$TOOLS/bin:$PATH"
    cargo fuzz --version >/dev/null 2>&1 || cargo install --locked --root "$TOOLS" cargo-fuzz
}

build() {
    say "building with sanitizer: $SANITIZER"
    # The versions of the program's dependencies.
    cp Cargo.lock tests/fuzz/Cargo.lock
    cargo +nightly fuzz build --fuzz-dir tests/fuzz --target-dir "$BUILD" --sanitizer "$SANITIZER"
}

log_of() { echo "$OUT/logs/$1.$2"; }

# Runs one process of a target, the log to a file.
fuzz() {
    local target=$1 number=$2 length timeout memory
    read -r length timeout memory <<<"${LIMITS[$target]}"
    "$BUILD/x86_64-unknown-linux-gnu/release/$target" \
        "$OUT/corpus/$target" "tests/fuzz/corpus/$target" -artifact_prefix="$OUT/artifacts/$target/" \
        -max_total_time="$seconds" -max_len="$length" -timeout="$timeout" -rss_limit_mb="$memory" \
        -print_final_stats=1 >"$(log_of "$target" "$number")" 2>&1
}

# The sum or the largest of a figure over the processes of a target.
figure() { sed -n "s/^stat::$2: *//p" "$OUT/logs/$1".* | awk -v how="$3" '
    { sum += $1; if ($1 > most) most = $1 } END { print how == "sum" ? sum + 0 : most + 0 }'; }

report() {
    local target found coverage
    printf '\n%-15s %12s %8s %9s %11s  %s\n' target executions per_s coverage memory_MiB found
    for target in "${targets[@]}"; do
        coverage=$(grep -ohE 'cov: [0-9]+' "$OUT/logs/$target".* | awk '$2 > most { most = $2 } END { print most + 0 }')
        found=$(sed -n 's/.*Test unit written to //p' "$OUT/logs/$target".* | tr '\n' ' ')
        printf '%-15s %12s %8s %9s %11s  %s\n' "$target" \
            "$(figure "$target" number_of_executed_units sum)" "$(figure "$target" average_exec_per_sec sum)" \
            "$coverage" "$(figure "$target" peak_rss_mb most)" "${found:-nothing}"
    done
}

seconds=60
[[ "${1:-}" =~ ^[0-9]+$ ]] && { seconds=$1; shift; }
targets=("$@")
[[ $# -gt 0 ]] || mapfile -t targets < <(printf '%s\n' "${!LIMITS[@]}" | sort)
for target in "${targets[@]}"; do
    [[ -v "LIMITS[$target]" ]] || die "there is no target $target; there are: $(printf '%s\n' "${!LIMITS[@]}" | sort | tr '\n' ' ')"
done

install_fuzzer
build
rm -rf "$OUT/logs"
mkdir -p "$OUT/logs"
# Readers that take a path get a file in memory.
[[ -n "${TMPDIR:-}" || ! -w /dev/shm ]] || export TMPDIR=/dev/shm
export RUST_BACKTRACE=1

processors=$(nproc)
each=$((processors / ${#targets[@]}))
each=$((each > 1 ? each : 1))
say "fuzzing ${#targets[@]} targets for $seconds s each, $processors processes at once"
failed=0 running=0
for target in "${targets[@]}"; do
    mkdir -p "$OUT/corpus/$target" "$OUT/artifacts/$target"
    for number in $(seq "$each"); do
        if ((running == processors)); then
            wait -n || failed=1
            running=$((running - 1))
        fi
        fuzz "$target" "$number" &
        running=$((running + 1))
    done
done
while ((running > 0)); do
    wait -n || failed=1
    running=$((running - 1))
done
report
((failed == 0)) || die "something was found: $OUT/logs has what was said, CONTRIBUTING.md what to do"
