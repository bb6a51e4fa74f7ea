#!/usr/bin/env bash
# A sweep of 400 runs in shards, with a worker killed in the middle; the table has to be that of one machine, to the byte.
#
#   scripts/cluster.sh slurm      Debian's Slurm with one node, installed and started here (root)
#   scripts/cluster.sh ray        Ray from PyPI, installed into target/ray and started in a network of its own (root)
#   scripts/cluster.sh parallel   GNU parallel of Debian
#   scripts/cluster.sh cost       no engine: what starting, running and merging take
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
tasks_of() { pgrep -f -- "^$CITY3D .*--out $1.* --shard [0-9]" || true; }

# kill_one OUT: kills a process that makes a shard of this sweep.
kill_one() {
    local task waited=0
    until task=$(tasks_of "$1" | head -1) && [[ -n $task ]] && kill -9 "$task" 2>/dev/null; do
        sleep 0.05
        ((waited += 1)) && [[ $waited -lt 1200 ]] || die "no task of $1 was found"
    done
}

# ---------------------------------------------------------------- Slurm

start_munge() {
    munge -n </dev/null 2>/dev/null | unmunge >/dev/null 2>&1 && return
    [[ -s /etc/munge/munge.key ]] || mungekey --create
    install -d -o munge -g munge -m 0755 /run/munge
    install -d -o munge -g munge -m 0700 /var/log/munge /var/lib/munge
    runuser -u munge -- /usr/sbin/munged
    STARTED_MUNGE=$(cat /run/munge/munged.pid)
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
        # They write at their ends into the folder that is removed next.
        timeout 20 tail --pid="$pid" -f /dev/null || true
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
    kill_one "$out"
    wait $waiting || { cat "$WORK/killed.log"; die "the study failed"; }
    cat "$WORK/killed.log"
    [[ $(grep -c '^job ' "$WORK/killed.log") == 2 ]] || die "nothing was submitted again"
    echo "-- $((SECONDS - start)) s"
    same "$out"

    say "the node is lost with all that runs on it: Slurm requeues its tasks"
    out=$WORK/lost start=$SECONDS
    "$CITY3D" sweep "${STUDY[@]}" --out "$out" --submit slurm --shards $SHARDS --go
    until_there 3 "$out/shards"
    local node job tasks
    job=$(cat "$out/sweep.job")
    node=$(hostname -s)
    until [[ -n $(tasks_of "$out") ]]; do sleep 0.05; done
    kill -9 "$(cat "$WORK/slurm/d.pid")"
    # Each task is the child of a slurmstepd. One may have ended in the meantime, and left its child to the first process.
    tasks=$(tasks_of "$out")
    # shellcheck disable=SC2046,SC2086
    kill -9 $(ps -o ppid= -p "${tasks//$'\n'/,}" | grep -vx ' *1') $tasks || true
    scontrol update nodename="$node" state=down reason=lost
    slurmd -f "$SLURM_CONF"
    scontrol update nodename="$node" state=resume 2>/dev/null || true
    # Slurm lets a requeued task wait for two minutes; a test does not.
    local task
    for task in $(squeue -h -r -t pending -o %A); do scontrol update jobid="$task" starttime=now 2>/dev/null || true; done
    "$CITY3D" sweep "${STUDY[@]}" --out "$out" --submit slurm --go --wait
    [[ $(cat "$out/sweep.job") == "$job" ]] || die "the tasks were submitted again in place of requeued"
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
    # Ray gives its workers the least share of a busy machine.
    export RAY_worker_niceness=0
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
    kill_one "$out"
    wait $running && die "parallel did not notice"
    "$CITY3D" sweep "${STUDY[@]}" --out "$out" --merge 2>&1 | tail -3 || true
    say "the same with --resume-failed"
    make_shards --resume-failed | tail -1
    "$CITY3D" sweep "${STUDY[@]}" --out "$out" --merge
    echo "-- $((SECONDS - start)) s"
    same "$out"
}

# ---------------------------------------------------------------- what a million runs cost

# seconds COMMAND...: the median of five calls, first on the wall, then of the processor.
seconds() {
    local TIMEFORMAT='%R %U %S' k
    for k in 1 2 3 4 5; do
        { time "$@" >/dev/null 2>&1; } 2>&1
    done | gawk '{ wall[NR] = $1; cpu[NR] = $2 + $3 } END { asort(wall); asort(cpu); print wall[3], cpu[3] }'
}

cost() {
    install_packages gawk python3
    trap 'rm -rf "$WORK"' EXIT
    # shard RUNS OF OPTIONS...: the first of OF shards, of so many runs together, on one thread.
    shard() {
        local runs=$1 of=$2
        shift 2
        "$CITY3D" sweep roundabout --environment testbed --threads 1 --seeds "1..$runs" --out "$WORK/cost" --shard "0/$of" --force "$@"
    }
    # told WHAT TIME [LESS RUNS]: milliseconds, of each run where some were made more.
    told() {
        gawk -v what="$1" -v time="$2" -v less="${3:-0 0}" -v runs="${4:-1}" 'BEGIN {
            split(time, a); split(less, b)
            printf "%-46s %9.1f %9.1f\n", what, 1000 * (a[1] - b[1]) / runs, 1000 * (a[2] - b[2]) / runs }'
    }
    local one many long
    printf '%-46s %9s %9s\n' "milliseconds" wall processor
    one=$(seconds shard 1 1 --duration 0.01)
    many=$(seconds shard 201 1 --duration 0.01)
    long=$(seconds shard 41 1)
    told "a process with one run of 0.01 s" "$one"
    told "the same, of a study of a million runs" "$(seconds shard 1000000 1000000 --duration 0.01)"
    told "each further run of 0.01 s" "$many" "$one" 200
    told "each further run of 40 s" "$long" "$one" 40
    gawk -v one="$one" -v long="$long" 'BEGIN { split(one, a); split(long, b)
        printf "a million runs of 40 s in 1000 processes: %.1f core hours\n", (1e6 * (b[2] - a[2]) / 40 + 1e3 * a[2]) / 3600 }'

    # A million rows in 1000 shards, made of one row.
    shard 1000000 1000000 --duration 0.01 >/dev/null
    python3 - "$WORK/cost/shards/0-of-1000000.csv" "$WORK/million/shards" <<'P'
import hashlib, os, sys
lines = open(sys.argv[1]).read().splitlines()
head = [line for line in lines if line.startswith("# ")]
columns, row = lines[len(head):]
rest = row.split(",", 1)[1]
os.makedirs(sys.argv[2])
for k in range(1000):
    rows = "".join(f"{line}\n" for line in [columns, *(f"{k * 1000 + seed},{rest}" for seed in range(1, 1001))])
    own = {"shard": f'"{k}/1000"', "first_run": k * 1000, "rows": 1000, "rows_sha256": f'"{hashlib.sha256(rows.encode()).hexdigest()}"'}
    kept = [f"# {key} = {own.get(key, value)}\n" for key, value in (line[2:].split(" = ", 1) for line in head)]
    open(f"{sys.argv[2]}/{k}-of-1000.csv", "w").write("".join(kept) + rows)
P
    merge() {
        rm -f "$WORK"/million/sweep.*
        "$CITY3D" sweep roundabout --environment testbed --duration 0.01 --seeds 1..1000000 --out "$WORK/million" --merge --parquet
    }
    told "merging the rows of a million runs" "$(seconds merge)"
    (cd "$WORK/million" && du -ch shards | tail -1 && ls -lh sweep.csv sweep.toml sweep.parquet | awk '{ print $9, $5 }')
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
    cost) cost ;;
    *) rm -rf "$WORK"; die "usage: scripts/cluster.sh slurm|ray|parallel|cost" ;;
esac
[[ $command == ray-inside ]] || say "passed"
