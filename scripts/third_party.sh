#!/usr/bin/env bash
# The crates of others that this repository carries with changes (third-party/README.md).
#
#   scripts/third_party.sh         checks that each is what crates.io publishes, with its patch and nothing else
#   scripts/third_party.sh patch   writes the patches again, after changes of the source that is carried
#
# Cargo fetches what was published, where it has not done so before; its checksum is recorded here.
set -euo pipefail
cd "$(dirname "$0")/.."
source scripts/setup.sh

name=rustdds
version=0.15.1
checksum=42683a88b9dc025d7d45771b88d20846443b4901ec4b045ca78b8dd316ab616f
# What is carried of it: no examples, tests and designs.
carried=(Cargo.toml LICENSE.md README.md src)

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT

# The file that was published, in Cargo's cache.
find_crate() { find "${CARGO_HOME:-$HOME/.cargo}/registry/cache" -name "$name-$version.crate" -print -quit 2>/dev/null; }

if [[ -z "$(find_crate)" ]]; then
    mkdir -p "$folder/fetch/src"
    touch "$folder/fetch/src/lib.rs"
    printf '[package]\nname = "fetch"\nversion = "0.0.0"\nedition = "2021"\n[dependencies]\n%s = { version = "=%s", default-features = false }\n' \
        "$name" "$version" >"$folder/fetch/Cargo.toml"
    cargo fetch --quiet --manifest-path "$folder/fetch/Cargo.toml"
fi
crate=$(find_crate)
echo "$checksum  $crate" | sha256sum --check --quiet || die "$crate is not what was published"
mkdir "$folder/published" "$folder/expected"
tar xzf "$crate" -C "$folder/published" --strip-components 1
(cd "$folder/published" && mv "${carried[@]}" "$folder/expected")
find "$folder/expected/src" -name '*.md' -delete

if [[ "${1:-}" == patch ]]; then
    ln -s "$folder/expected" "$folder/a"
    ln -s "$PWD/third-party/$name" "$folder/b"
    # Without times. A difference is what diff is for.
    (cd "$folder" && diff -Nru a/ b/ || true) | sed -E '/^diff -Nru /d; s/^(---|\+\+\+) ([^\t]*)\t.*/\1 \2/' \
        >"third-party/$name.patch"
    echo "third-party/$name.patch: $(grep -c '^[+-][^+-]' "third-party/$name.patch") lines changed"
else
    (cd "$folder/expected" && git apply --whitespace=nowarn -p1 - <"$OLDPWD/third-party/$name.patch")
    diff -r "$folder/expected" "third-party/$name" || die "third-party/$name is not $name $version with third-party/$name.patch"
    echo "third-party/$name is $name $version with third-party/$name.patch"
fi
