#!/usr/bin/env bash
# A sweep of 400 runs in shards, with a worker killed in the middle; the table has to be that of one machine, to the byte.
#
#   scripts/cluster.sh slurm      Debian's Slurm with one node, installed and started here (root)
#   scripts/cluster.sh ray        Ray from PyPI, installed into target/ray and started in a network of its own (root)
#   scripts/cluster.sh parallel   GNU parallel of Debian
#
# CITY3D is the program, target/release/city3d by default; ray builds the Python package of the development build.
# Nothing keeps running: what the script has started it ends.
set -euo pipefail
cd "$(dirname "$0")/.."
source scripts/setup.sh

export CITY3D=$(realpath "${CITY3D:-target/release/city3d}")
# 4 values and 100 seeds.
STUDY=(roundabout --environment testbed --duration "${DURATION:-20}" --set environment.command_delay_s=0:0.3:0.1 --seeds 1..100)
SHARDS=16

# The table of one machine, in $WORK/one.
run_here() {
    say "400 runs on one machine"
    local start=$SECONDS
    "$CITY3D" sweep "${STUDY[@]}" --out "$WORK/one" | tail -1
    echo "-- $((SECONDS - start)) s"
}

# same OUT: its table and its figures are those of one machine.
same() {
    local file
    for file in sweep.csv sweep.toml merge_success.csv collisions.svg; do
        cmp "$WORK/one/$file" "$1/$file" || die "$1/$file is not that of one machine"
    done
    echo "the table is that of one machine, to the byte: $(sha256sum <"$1/sweep.csv" | cut -c1-16), $(wc -l <"$1/sweep.csv") lines"
}

# until_there COUNT FOLDER: waits for so many whole shards.
until_there() {
    local waited=0
    until [[ $(find "$2" -name '*-of-*.csv' 2>/dev/null | wc -l) -ge $1 ]]; do
        sleep 0.2
        ((waited += 1)) && [[ $waited -lt 3000 ]] || die "no $1 shards in $2 after 10 minutes"
    done
}

# tasks_of OUT: the processes that make shards of this sweep.
tasks_of() { pgrep -f -- "--out $1 .*--shard" || true; }

# ---------------------------------------------------------------- Slurm

start_munge() {
    munge -n </dev/null 2>/dev/null | unmunge >/dev/null 2>&1 && return
    [[ -s /etc/munge/munge.key ]] || mungekey --create
    install -d -o munge -g munge -m 0755 /run/munge
    install -d -o munge -g munge -m 0700 /var/log/munge /var/lib/munge
    runuser -u munge -- /usr/sbin/munged
    STARTED_MUNGE=$(pgrep -xo munged)
    munge -n </dev/null | unmunge >/dev/null || die "munged does not answer"
}

start_slurm() {
    local node ports
    node=$(hostname -s)
    mapfile -t ports < <(python3 - <<'P'
import socket
held = [socket.socket() for _ in range(2)]
for one in held:
    one.bind(("127.0.0.1", 0))
    print(one.getsockname()[1])
P
    )
    mkdir -p "$WORK/slurm/state" "$WORK/slurm/spool" "$WORK/slurm/log"
    export SLURM_CONF=$WORK/slurm/slurm.conf
    cat >"$SLURM_CONF" <<CONF
ClusterName=city3d
SlurmctldHost=$node(127.0.0.1)
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
CredType=cred/munge
SlurmctldPort=${ports[0]}
SlurmdPort=${ports[1]}
StateSaveLocation=$WORK/slurm/state
SlurmdSpoolDir=$WORK/slurm/spool
SlurmctldPidFile=$WORK/slurm/ctld.pid
SlurmdPidFile=$WORK/slurm/d.pid
SlurmctldLogFile=$WORK/slurm/log/ctld.log
SlurmdLogFile=$WORK/slurm/log/d.log
ProctrackType=proctrack/pgid
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
JobCompType=jobcomp/none
MpiDefault=none
SwitchType=switch/none
SchedulerType=sched/backfill
SchedulerParameters=batch_sched_delay=0,sched_interval=1,bf_interval=1,defer_batch
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
ReturnToService=2
MaxArraySize=1001
SlurmdTimeout=10
KillWait=5
NodeName=$node NodeAddr=127.0.0.1 CPUs=$(nproc) RealMemory=1000 State=UNKNOWN
PartitionName=main Nodes=ALL Default=YES MaxTime=INFINITE State=UP
CONF
    slurmctld -f "$SLURM_CONF"
    slurmd -f "$SLURM_CONF"
    local waited=0
    until [[ $(sinfo -h -o %t 2>/dev/null) == idle ]]; do
        sleep 0.2
        ((waited += 1)) && [[ $waited -lt 150 ]] || { cat "$WORK"/slurm/log/*.log; die "the node is not idle after 30 s"; }
    done
    sinfo --version
}

stop_slurm() {
    scancel --user="$(id -un)" 2>/dev/null || true
    sleep 1
    local pid
    for pid in $(cat "$WORK"/slurm/*.pid 2>/dev/null) ${STARTED_MUNGE:-}; do
        kill "$pid" 2>/dev/null || true
    done
    for pid in $(tasks_of "$WORK"); do kill -9 "$pid" 2>/dev/null || true; done
}

slurm() {
    [[ $(id -u) == 0 ]] || die "Slurm is installed and started as root"
    install_packages slurm-wlm munge python3 procps
    trap 'stop_slurm; rm -rf "$WORK"' EXIT
    run_here
    say "Slurm"
    start_munge
    start_slurm

    say "a program is killed: its task fails, and is submitted again"
    local out=$WORK/killed start=$SECONDS
    "$CITY3D" sweep "${STUDY[@]}" --out "$out" --submit slurm --shards $SHARDS --go --wait >"$WORK/killed.log" 2>&1 &
    local waiting=$!
    until_there 3 "$out/shards"
    kill -9 "$(tasks_of "$out" | head -1)"
    wait $waiting || { cat "$WORK/killed.log"; die "the study failed"; }
    cat "$WORK/killed.log"
    [[ $(grep -c '^job ' "$WORK/killed.log") == 2 ]] || die "nothing was submitted again"
    echo "-- $((SECONDS - start)) s"
    same "$out"

    say "the node is lost with all that runs on it: Slurm requeues its tasks"
    out=$WORK/lost start=$SECONDS
    "$CITY3D" sweep "${STUDY[@]}" --out "$out" --submit slurm --shards $SHARDS --go
    until_there 3 "$out/shards"
    # The steps are children of the daemon, with the program as a child.
    local node daemon steps
    node=$(hostname -s)
    daemon=$(cat "$WORK/slurm/d.pid")
    steps=$(pgrep -f '^slurmstepd: \[' | tr '\n' ' ')
    # shellcheck disable=SC2086
    kill -9 "$daemon" $steps $(tasks_of "$out")
    scontrol update nodename="$node" state=down reason=lost
    slurmd -f "$SLURM_CONF"
    scontrol update nodename="$node" state=resume 2>/dev/null || true
    # Slurm lets a requeued task wait for two minutes; a test does not.
    local task
    for task in $(squeue -h -r -t pending -o %A); do scontrol update jobid="$task" starttime=now 2>/dev/null || true; done
    "$CITY3D" sweep "${STUDY[@]}" --out "$out" --submit slurm --go --wait
    echo "-- $((SECONDS - start)) s"
    same "$out"
    head -3 "$out/shards.csv" | cut -c1-200
}

# ---------------------------------------------------------------- Ray

ray_cluster() {
    [[ $(id -u) == 0 ]] || die "Ray listens on all addresses: it is started in a network of its own, which needs root"
    install_packages python3-venv iproute2 procps
    find_rust
    scripts/python.sh package
    printf 'numpy==2.4.6\nray==2.60.0\n' >target/ray-requirements.txt
    make_venv target/ray target/ray-requirements.txt
    trap 'rm -rf "$WORK"' EXIT
    run_here
    export WORK DURATION
    # All that Ray starts ends with the first process of this namespace.
    unshare --net --pid --fork --mount-proc "$0" ray-inside
}

ray_inside() {
    ip link set lo up
    export PATH=$PWD/target/ray/bin:$PATH PYTHONPATH=$PWD/target/python-package RAY_ADDRESS=127.0.0.1:6379 RAY_DEDUP_LOGS=0
    say "$(ray --version)"
    ray start --head --node-ip-address=127.0.0.1 --num-cpus="$(nproc)" --port=6379 --include-dashboard=false \
        --disable-usage-stats --object-store-memory=100000000 --temp-dir="$WORK/ray" >"$WORK/ray.log" 2>&1 ||
        { cat "$WORK/ray.log"; die "Ray does not start"; }
    local out=$WORK/ray-out start=$SECONDS
    python - "$out" "$SHARDS" "${DURATION:-20}" >"$WORK/driver.log" 2>&1 <<'P' &
import sys
from city3d import studies
out, shards, duration = sys.argv[1:]
study = {"environment": "testbed", "duration_s": duration, "set": {"environment.command_delay_s": "0:0.3:0.1"}}
table = studies.sweep("roundabout", out, shards=int(shards), seeds=range(1, 101), parquet=True, **study)
print(table)
kept = studies.record("roundabout", out + "/store", seeds=[1, 2], duration_s=5, pictures=["--camera", "overhead", "--every", "2", "--size", "160x120"])
print([run["seed"] for run in kept])
P
    local driver=$!
    until_there 3 "$out/shards"
    say "a worker is killed"
    local worker
    worker=$(pgrep -f '^ray::_shard' | head -1)
    kill -9 "$worker"
    wait $driver || { cat "$WORK/driver.log"; die "the study failed"; }
    grep -v '^$' "$WORK/driver.log" | cut -c1-200 | tail -12
    echo "-- $((SECONDS - start)) s"
    same "$out"
    (cd "$out/store" && find . -type f | sort | head -20)
    ray stop --force >/dev/null 2>&1 || true
}

# ---------------------------------------------------------------- GNU parallel

gnu_parallel() {
    install_packages parallel procps
    trap 'rm -rf "$WORK"' EXIT
    run_here
    say "$(parallel --version | head -1)"
    local out=$WORK/parallel start=$SECONDS
    make_shards() {
        seq 0 $((SHARDS - 1)) | parallel --will-cite -j"$(nproc)" --joblog "$WORK/joblog" "$@" \
            "$CITY3D" sweep "${STUDY[@]}" --threads 1 --out "$out" --shard "{}/$SHARDS"
    }
    make_shards >/dev/null 2>&1 &
    local running=$!
    until_there 3 "$out/shards"
    say "a program is killed"
    kill -9 "$(pgrep -x city3d -a | grep -- "--out $out " | head -1 | cut -d' ' -f1)"
    wait $running && die "parallel did not notice"
    "$CITY3D" sweep "${STUDY[@]}" --out "$out" --merge 2>&1 | tail -3 || true
    say "the same with --resume-failed"
    make_shards --resume-failed | tail -1
    "$CITY3D" sweep "${STUDY[@]}" --out "$out" --merge
    echo "-- $((SECONDS - start)) s"
    same "$out"
}

command=${1:-}
if [[ $command != ray-inside ]]; then
    [[ -x $CITY3D ]] || die "$CITY3D is not there; build it with cargo build --release, or set CITY3D"
    WORK=$(mktemp -d "${TMPDIR:-/tmp}/city3d-cluster-XXXXXX")
fi
case "$command" in
    slurm) slurm ;;
    ray) ray_cluster ;;
    ray-inside) ray_inside ;;
    parallel) gnu_parallel ;;
    *) rm -rf "$WORK"; die "usage: scripts/cluster.sh slurm|ray|parallel" ;;
esac
say "passed"
