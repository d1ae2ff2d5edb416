# The recipes are thin wrappers of cargo commands.

# The build folder of scripts/run and scripts/test.
export CARGO_TARGET_DIR := env("CARGO_TARGET_DIR", env("XDG_CACHE_HOME", env("HOME") / ".cache") / "ocu/target")

# List the recipes.
default:
    @just --list

# Check formatting, clippy and rustdoc, which a change must pass.
lint:
    cargo fmt --all --check
    cargo clippy --locked --workspace --all-targets -- -D warnings
    RUSTDOCFLAGS="-D warnings" cargo doc --locked --workspace --no-deps

# Run all tests, or those whose names contain the given words.
test *ARGS:
    scripts/test {{ ARGS }}

# Write the skeleton of a plugin: just new-plugin slope_cost.
new-plugin NAME:
    scripts/new-plugin {{ NAME }}

# Write the skeleton of a view: just new-view event_log.
new-view NAME:
    scripts/new-view {{ NAME }}

# Write docs/reference and the tables of the README anew.
docs:
    scripts/docs

# Draw the pictures of the README anew.
pictures:
    scripts/pictures

# Run one bench together with its peers: just bench runtime.
bench NAME *ARGS:
    cargo bench --manifest-path benches/Cargo.toml --bench {{ NAME }} -- {{ ARGS }}

# Rewrite golden traces and the snapshots of texts and windows; review the diff before committing it.
golden *ARGS:
    INSTA_UPDATE=always UPDATE_SNAPSHOTS=1 UPDATE_GOLDEN=1 scripts/test {{ ARGS }}
    git diff --stat

# Read ten thousand damaged copies of real recordings, and print the figures. Needs the recordings in $OCU_DATA.
torture:
    cargo test --locked --workspace --lib torture -- --ignored --nocapture

# Run what takes too long for every change: the damaged recordings, and ten minutes of each fuzz target.
nightly: torture
    for target in fuzz/fuzz_targets/*.rs; do just fuzz "$(basename "$target" .rs)" 600; done

# Fuzz one target for a minute: just fuzz log_reader. Needs cargo-fuzz; without a nightly toolchain, the stable one is used without sanitizers.
fuzz TARGET SECONDS="60":
    scripts/fuzz {{ TARGET }} {{ SECONDS }}
