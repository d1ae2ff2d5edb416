# Thin over cargo: what each recipe does can be typed as well.

# The build folder of scripts/run and scripts/test.
export CARGO_TARGET_DIR := env("CARGO_TARGET_DIR", env("XDG_CACHE_HOME", env("HOME") / ".cache") / "ocu/target")

# List the recipes.
default:
    @just --list

# Formatting, clippy and rustdoc, as a change must pass them.
lint:
    cargo fmt --all --check
    cargo clippy --locked --workspace --all-targets -- -D warnings
    RUSTDOCFLAGS="-D warnings" cargo doc --locked --workspace --no-deps

# Every test, or those whose names hold the words given.
test *ARGS:
    scripts/test {{ ARGS }}

# One bench beside its peers: just bench runtime.
bench NAME *ARGS:
    cargo bench --manifest-path benches/Cargo.toml --bench {{ NAME }} -- {{ ARGS }}

# Write golden traces and the snapshots of texts and windows anew; read the diff before it is committed.
golden *ARGS:
    INSTA_UPDATE=always UPDATE_SNAPSHOTS=1 UPDATE_GOLDEN=1 scripts/test {{ ARGS }}
    git diff --stat

# Damage ten thousand copies of real recordings and read them; prints the figures. Needs the recordings in $OCU_DATA.
torture:
    cargo test --locked --workspace --lib torture -- --ignored --nocapture

# What takes too long for every change: the tortured recordings, and ten minutes of each fuzz target.
nightly: torture
    for target in log_reader field_scanner cdr schema payload scene_file stack_file; do just fuzz $target 600; done

# Fuzz one target for a minute: just fuzz log_reader. Needs a nightly toolchain and cargo-fuzz.
fuzz TARGET SECONDS="60":
    mkdir -p fuzz/corpus/{{ TARGET }}
    cargo +nightly fuzz run --fuzz-dir fuzz {{ TARGET }} fuzz/corpus/{{ TARGET }} fuzz/seeds/{{ TARGET }} -- -max_total_time={{ SECONDS }}
