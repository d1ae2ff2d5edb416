# Sourced by scripts/run, scripts/test and .ci/run; not a command by itself.
# Requires `root`, the folder of the checkout.

cache="${XDG_CACHE_HOME:-${HOME:-/root}/.cache}/ocu"

# One build folder outside of the checkout, so that several checkouts share build results.
export CARGO_TARGET_DIR="${CARGO_TARGET_DIR:-$cache/target}"
# What an incremental build makes is about a tenth slower, and a part of it that an interruption left may link with nothing
# any more. Cargo keeps a second build of the workspace where this differs, so all scripts have the same.
export CARGO_INCREMENTAL="${CARGO_INCREMENTAL:-0}"

# Window tests need a Vulkan driver; a window also needs the X11 and OpenGL libraries that egui and wgpu load at run
# time.
packages_vulkan=(mesa-vulkan-drivers)
packages_window=(libxkbcommon-x11-0 libegl1 libgl1 libx11-xcb1 libxcursor1 libxi6 libgl1-mesa-dri)

say() { printf '%s\n' "$*" >&2; }

# need_packages NAME...: installs missing Debian packages, or prints the command that does and exits.
need_packages() {
    if ! command -v dpkg-query >/dev/null || ! command -v apt-get >/dev/null; then
        say "not a Debian system: these packages, or what matches them here, are taken as present: $*"
        return 0
    fi
    local missing=() name
    for name in "$@"; do
        [[ $(dpkg-query -W -f '${db:Status-Abbrev}' "$name" 2>/dev/null || true) == ii* ]] || missing+=("$name")
    done
    [[ ${#missing[@]} -gt 0 ]] || return 0

    local as_root=()
    if [[ $(id -u) -ne 0 ]]; then
        # sudo may ask for a password, which works only if someone can type it.
        if command -v sudo >/dev/null && { sudo -n true 2>/dev/null || [[ -t 0 ]]; }; then
            as_root=(sudo)
        else
            say "packages are missing; as root, run:"
            say "    apt-get update && apt-get install -y --no-install-recommends ${missing[*]}"
            exit 1
        fi
    fi
    say "installing ${missing[*]}"
    "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get update -q >&2
    "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive \
        apt-get install -y -q --no-install-recommends "${missing[@]}" >&2
}

# need_tools: asks for Rust if it is missing, because Debian's version is too old.
need_tools() {
    if ! command -v cargo >/dev/null && [[ -x "${CARGO_HOME:-${HOME:-/root}/.cargo}/bin/cargo" ]]; then
        PATH="${CARGO_HOME:-${HOME:-/root}/.cargo}/bin:$PATH"
    fi
    if ! command -v cargo >/dev/null; then
        say "cargo is missing: install Rust 1.95 or newer from https://rustup.rs and start this again"
        exit 1
    fi
    command -v cc >/dev/null || need_packages gcc libc6-dev
}

# camel NAME: slope_cost -> SlopeCost
camel() { sed -E 's/(^|_)([a-z0-9])/\u\2/g' <<<"$1"; }

# fill TEMPLATE FILE NAME TYPE: writes a template with the names in place.
fill() {
    local title="${3//_/ }"
    mkdir -p "$(dirname "$2")"
    sed -e "s/@name@/$3/g" -e "s/@snake@/$3/g" -e "s/@dashed@/${3//_/-}/g" -e "s/@Type@/$4/g" -e "s/@Title@/${title^}/g" \
        "$1" >"$2"
}

# insert_after FILE PATTERN COUNT LINE: puts a line after the COUNT-th line that matches, before the first one for 0.
insert_after() {
    awk -v pattern="$2" -v count="$3" -v line="$4" '
        $0 ~ pattern && count == 0 && !done { print line; done = 1 }
        { print }
        $0 ~ pattern && ++seen == count { print line; done = 1 }
    ' "$1" >"$1.new"
    mv "$1.new" "$1"
}

# insert_sorted FILE PATTERN LINE: puts a line among the first lines that match and follow each other, in their order.
insert_sorted() {
    LC_ALL=C awk -v pattern="$2" -v line="$3" '
        $0 ~ pattern { inside = 1; if (!done && $0 > line) { print line; done = 1 } }
        $0 !~ pattern && inside && !done { print line; done = 1 }
        { print }
    ' "$1" >"$1.new"
    mv "$1.new" "$1"
}
