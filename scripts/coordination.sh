#!/bin/sh
# The experiments of coordination: a merge, the roundabout, an intersection under every controller, human drivers among
# automated vehicles, planning again, a corridor and a platoon, each in the ideal environment and in the testbed emulator.
# Usage: scripts/coordination.sh [FOLDER] [SEEDS] [EXPERIMENT ...]; docs/experiments.md has what came out. Figures are in
# FOLDER/figures. The second time it continues sweeps that were stopped.
set -eu
cd "$(dirname "$0")/.."
out=${1:-out/coordination}
seeds=${2:-1..20}
[ $# -ge 2 ] && shift 2 || shift $#
[ $# -gt 0 ] || set -- merge roundabout intersection penetration replanning corridor platoon
# Another program than that of this folder: CITY3D=/usr/bin/city3d scripts/coordination.sh
city3d=${CITY3D:-}
if [ -z "$city3d" ]; then
    cargo build --release --locked
    city3d=${CARGO_TARGET_DIR:-target}/release/city3d
fi
mkdir -p "$out/scenarios"

# One line for each combination of the axes of a table: means over seeds, half the width of their 95 % interval
# (Student's t for 20 runs) for the delay.
figures() {
    awk -F, -v name="$1" '
        NR == 1 { for (k = 1; k <= NF; k++) column[$k] = k; next }
        { key = ""; for (k = 1; k < column["seed"]; k++) key = key (k > 1 ? " " : "") $k; if (!(key in n)) keys[++count] = key
          n[key]++; delay = $column["mean_delay_s"] + 0; sum[key] += delay; squares[key] += delay * delay
          travel[key] += $column["mean_travel_s"]; flow[key] += $column["throughput_per_h"]; stops[key] += $column["slow_stops"]
          u2[key] += $column["int_u2_m2ps3"]; fuel[key] += $column["fuel_ml"]; cruise[key] += $column["fuel_with_cruise_ml"]
          passed[key] += $column["passages"]; collisions[key] += $column["collisions"] }
        END { for (k = 1; k <= count; k++) { key = keys[k]; m = sum[key] / n[key]
          spread = squares[key] / n[key] - m * m; if (spread < 0) spread = 0
          ci = n[key] > 1 ? 2.093 * sqrt(spread / (n[key] - 1)) : 0
          printf "%-24s %-16s  delay %7.3f +- %.3f s  travel %6.2f s  flow %5.0f /h  stops %6.1f  u2 %.4f m2/s3  fuel %.1f / %.1f mL  passages %.0f  collisions %d\n",
              name, key, m, ci, travel[key] / n[key], flow[key] / n[key], stops[key] / n[key], u2[key] / n[key],
              fuel[key] / n[key], cruise[key] / n[key], passed[key] / n[key], collisions[key] } }' "$2/sweep.csv"
}

# sweep NAME SCENARIO OPTION ...
sweep() {
    name=$1 scenario=$2
    shift 2
    "$city3d" sweep "$scenario" --out "$out/$name" --force --seeds "$seeds" "$@" >/dev/null
    figures "$name" "$out/$name"
}

# both FIGURE SWEEP ...: delays of several sweeps in one table and one figure.
both() {
    figure=$1
    shift
    "$city3d" compare "$@" --out "$out/figures/$figure" --force
}

roundabout() {
    for scenario in roundabout roundabout-coordinated; do
        for environment in ideal testbed; do
            "$city3d" run "$scenario" --environment "$environment" --out "$out/$scenario-$environment" --force
            "$city3d" plot "$out/$scenario-$environment" --out "$out/figures/$scenario-$environment" --force >/dev/null
        done
        "$city3d" sweep "$scenario" --environment testbed --seeds 1..50 --out "$out/$scenario-seeds" --force >/dev/null
        figures "$scenario-seeds" "$out/$scenario-seeds"
    done
}

# Who goes first at an intersection, at 600 to 1800 vehicles an hour in all.
intersection() {
    { cat scenarios/intersection.toml
      printf '\n[right_of_way]\nall_way_stop = ["junction-1-1"]\nfull_stop = true\n'; } \
        | sed -e 's/^algorithm = .*/algorithm = "none"/' -e 's/^name = "intersection"/name = "all-way stop"/' \
        >"$out/scenarios/all-way-stop.toml"
    for environment in ideal testbed; do
        rates=150,225,300,375,450
        [ "$environment" = ideal ] || rates=150,225,300
        sweep "intersection-$environment" intersection --environment "$environment" \
            --set "inflow.*.rate_veh_h=$rates" --set coordination.algorithm=none,fifo,insert,priority
        # Planning again takes minutes for a run beyond 1200 vehicles an hour.
        sweep "replan-$environment" intersection --environment "$environment" \
            --set "inflow.*.rate_veh_h=$rates" --set coordination.algorithm=replan
        sweep "all-way-stop-$environment" "$out/scenarios/all-way-stop.toml" --environment "$environment" \
            --set "inflow.*.rate_veh_h=$rates"
        sweep "signals-$environment" intersection-signals --environment "$environment" \
            --set "inflow.*.rate_veh_h=$rates" --set signal.1.kind=webster,actuated
        both "intersection-$environment" "$out/replan-$environment" "$out/intersection-$environment" \
            "$out/all-way-stop-$environment" "$out/signals-$environment"
    done
}

# Human drivers among automated vehicles, 1200 vehicles an hour.
penetration() {
    for environment in ideal testbed; do
        sweep "penetration-$environment" intersection --environment "$environment" \
            --set "inflow.*.share_cav=0,0.2,0.4,0.6,0.8,1" --set "inflow.*.rate_veh_h=300"
    done
    both penetration "$out/penetration-ideal" "$out/penetration-testbed"
}

# Planning once and planning again, with the values of Le and Malikopoulos (2025): 20 m/s, 3 and -4 m/s2, 250 m of road,
# 2 s between crossing vehicles; everybody drives straight on.
replanning() {
    sed -e 's/^destinations = .*"street-1\/east\/2" = 3.*/destinations = ["street-1\/east\/2"]/' \
        -e 's/^destinations = .*"avenue-1\/north\/2" = 3.*/destinations = ["avenue-1\/north\/2"]/' \
        -e 's/^destinations = .*"street-1\/west\/2" = 3.*/destinations = ["street-1\/west\/2"]/' \
        -e 's/^destinations = .*"avenue-1\/south\/2" = 3.*/destinations = ["avenue-1\/south\/2"]/' \
        -e 's/^desired_speed_mps = .*/desired_speed_mps = 0.8\nmin_acceleration_mps2 = -0.16/' \
        scenarios/intersection.toml >"$out/scenarios/replanning.toml"
    for algorithm in fifo insert replan; do
        sweep "replanning-$algorithm" "$out/scenarios/replanning.toml" \
            --set "inflow.*.rate_veh_h=300,350,400" --set "coordination.algorithm=$algorithm"
    done
    both replanning "$out/replanning-fifo" "$out/replanning-insert" "$out/replanning-replan"
}

corridor() {
    for environment in ideal testbed; do
        sweep "corridor-$environment" corridor --environment "$environment" \
            --set "inflow.*.rate_veh_h=75,112.5,150" --set coordination.algorithm=none,insert,replan
        # Too slow for one figure with the others.
        sweep "corridor-fifo-$environment" corridor --environment "$environment" \
            --set "inflow.*.rate_veh_h=75,112.5,150" --set coordination.algorithm=fifo
    done
    both corridor "$out/corridor-ideal" "$out/corridor-testbed"
}

merge() {
    for environment in ideal testbed; do
        for algorithm in none fifo insert; do
            sweep "merge-$algorithm-$environment" merge --environment "$environment" --set "coordination.algorithm=$algorithm"
        done
    done
    for algorithm in none fifo; do
        "$city3d" run merge --set "coordination.algorithm=$algorithm" --out "$out/merge-$algorithm" --force >/dev/null
    done
    "$city3d" compare "$out/merge-none" "$out/merge-fifo" --out "$out/figures/merge" --force >/dev/null
}

# gains FREQUENCY TABLE: amplification of each car's speed and from the first to the last car, by the Fourier components of
# their speeds at the leader's frequency from 60 s to 140 s.
gains() {
    awk -F, -v frequency="$1" '
        NR == 1 { for (k = 1; k <= NF; k++) column[$k] = k; next }
        $column["t"] > 60 && $column["t"] < 140.0001 {
            id = $column["id"]; phase = 2 * 3.14159265358979 * frequency * $column["t"]
            c[id] += $column["speed"] * cos(phase); s[id] += $column["speed"] * sin(phase); if (id > last) last = id }
        END { low = 1e9
            for (id = 2; id <= last; id++) {
                gain = sqrt(c[id] ^ 2 + s[id] ^ 2) / sqrt(c[id - 1] ^ 2 + s[id - 1] ^ 2)
                if (gain < low) low = gain; if (gain > high) high = gain }
            printf "%.3f %.3f %.3f\n", low, high, sqrt(c[last] ^ 2 + s[last] ^ 2) / sqrt(c[1] ^ 2 + s[1] ^ 2) }' "$2"
}

# Seven cars behind a leader whose speed oscillates: does the oscillation grow?
platoon() {
    seeds_of_testbed=$(seq "${seeds%..*}" "${seeds#*..}")
    for controller in cacc ploeg idm; do
        for frequency in 0.05 0.1 0.2; do
            set -- --set "driver.default.controller=$controller" --set "driver.leader.frequency_hz=$frequency"
            "$city3d" run platoon "$@" --out "$out/platoon-$controller-$frequency" --force >/dev/null
            echo "platoon ideal $controller $frequency Hz: a car, a car, first to last:" \
                "$(gains "$frequency" "$out/platoon-$controller-$frequency/vehicles.csv")"
            for seed in $seeds_of_testbed; do
                "$city3d" run platoon "$@" --environment testbed --seed "$seed" --out "$out/platoon-testbed" --force >/dev/null
                gains "$frequency" "$out/platoon-testbed/vehicles.csv"
            done | awk -v name="platoon testbed $controller $frequency Hz, first to last" '
                { sum += $3; squares += $3 * $3; n++ }
                END { m = sum / n; spread = squares / n - m * m; if (spread < 0) spread = 0
                      printf "%s: %.3f +- %.3f\n", name, m, (n > 1 ? 2.093 * sqrt(spread / (n - 1)) : 0) }'
        done
    done
    "$city3d" compare "$out/platoon-idm-0.1" "$out/platoon-ploeg-0.1" --vehicle car1,car4,car8 \
        --out "$out/figures/platoon" --force >/dev/null
}

for experiment in "$@"; do
    "$experiment"
done
