#!/bin/sh
# Builds the Debian package and prints its path.
#
#     packaging/debian/build.sh
#
# It is made of the release build of this tree, whose completions and man pages the program itself writes. cargo-deb lives in
# target/cargo-deb, made at the first run.
set -eu

root=$(cd "$(dirname "$0")/../.." && pwd)
target=${CARGO_TARGET_DIR:-$root/target}
tool=$target/cargo-deb/bin/cargo-deb
version=3.8.0

command -v dpkg-shlibdeps >/dev/null || {
    echo "dpkg-shlibdeps is not there, which knows the libraries that a package needs: sudo apt-get install dpkg-dev" >&2
    exit 1
}
if [ "$("$tool" --version 2>/dev/null)" != $version ]; then
    cargo install --quiet --locked --root "$target/cargo-deb" "cargo-deb@$version"
fi

cargo build --quiet --release --manifest-path "$root/Cargo.toml" --package orchestrator --bin gerono
generated=$target/release/debian
rm -rf "$generated"
mkdir -p "$generated/man"
for shell in bash zsh fish; do
    "$target/release/gerono" completions $shell >"$generated/gerono.$shell"
done
"$target/release/gerono" man --out "$generated/man" >/dev/null
gzip --best --no-name "$generated"/man/*.1
"$tool" deb --quiet --no-build --manifest-path "$root/orchestrator/Cargo.toml"
