//! `docs/reference/stacks.md`: every key of a stack file, from the structures that it is read into.

use super::check_reference;
use super::declarations::{fields, keys, variants, words};

const FILE: &str = "core/runtime/src/stack/file.rs";
const COMPOSE: &str = "core/runtime/src/stack/compose/mod.rs";
const ARGUMENTS: &str = "core/runtime/src/stack/compose/arguments.rs";

#[test]
fn the_reference_of_stack_files_is_made_from_what_reads_them() {
    let text = [
        "# Stack files\n\nTOML; every key, made from the structures that a file is read into. An unknown key is an error. \
         `ocu stack check` finds what is wrong, `ocu stack show` prints a stack with its parts in place.\n\n## At the top\n\n",
        &keys(&fields(FILE, "Content")),
        "## `[[input]]`\n\n",
        &keys(&fields(FILE, "InputEntry")),
        "## `[[process]]`\n\nPorts and parameters of each plugin are in [plugins.md](plugins.md).\n\n",
        &keys(&fields(FILE, "ProcessEntry")),
        &words("`class`", &variants(FILE, "Class")),
        "## `[buffers.\"/name\"]`\n\n",
        &keys(&fields(FILE, "BufferEntry")),
        &words("`overflow`", &variants(FILE, "OverflowEntry")),
        &words("`writers`", &variants(FILE, "WritersEntry")),
        "## `[[include]]`\n\n",
        &keys(&fields(COMPOSE, "Include")),
        "What a part says as `course`, `remembers` or `authority_s` counts for the stack that includes it, unless that says \
         it, too. Its `name` and `description` are its own.\n\n",
        "## `[arguments.NAME]` of a part\n\nA part says `${name}` in its texts.\n\n",
        &keys(&fields(ARGUMENTS, "Declaration")),
        "## `[change.PROCESS]`\n\nKeys of a process that came with a part, as in `[[process]]`: each replaces the part's, \
         `inputs`, `outputs` and `params` entry by entry.\n\n",
        "## Values of the course\n\n`\"${vehicle.wheels.track_m}\"` as the value of a parameter is a key of the file that \
         the course names as its `vehicle`; likewise `world`. A parameter that is a file takes the course's file of its \
         kind, whatever the stack says; `--param` counts more.\n",
    ]
    .concat();
    check_reference("stacks", &text);
}
