#!/usr/bin/env bash
# From a fresh machine with Rust to pictures of the roundabout. Everything goes to out/ and target/.
set -euo pipefail
cd "$(dirname "$0")/.."
source scripts/setup.sh

set_up

say "building"
cargo build --release --locked
city3d="${CARGO_TARGET_DIR:-target}/release/city3d"

say "running the roundabout"
"$city3d" run scenarios/roundabout.toml --out out/demo/roundabout --force

say "drawing what its cameras see"
"$city3d" frames scenarios/roundabout.toml --out out/demo/frames --force \
    --vehicle path1_a --vehicle path2_a --camera windscreen --camera chase \
    --camera overhead --at "-56.75,-54.25" --every 3 --size 960x540

say "done"
cat <<END
run       $PWD/out/demo/roundabout
          summary.json   what happened, in figures
          vehicles.csv   every vehicle, ten times a second
          run.mcap       the whole log: open it in Foxglove
pictures  $PWD/out/demo/frames ($(find out/demo/frames -name '*.png' | wc -l) PNG files; frames.csv says what they are)
END
