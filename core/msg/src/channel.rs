//! What a channel of a recording says beside its messages. `docs/reference/channels.md` is made from this.

/// The header of a message in a recording that this program writes.
pub const TIMES: &[(&str, &str)] = &[
    ("log_time", "When the message became visible to other processes, in nanoseconds of the run. It orders."),
    (
        "publish_time",
        "Acquisition time: when what the message tells of was sensed, as its writer says. A map has that of its newest \
         source. `log_time` less `publish_time` is the age that `ocu latency` tells.",
    ),
    ("sequence", "Number of the message in its buffer, from 1: a gap is a message that was not recorded."),
];

/// Key of the metadata of a channel that this program records: who writes it.
pub const WRITER: &str = "rcs.writer";

/// Keys of the metadata of a channel.
pub const METADATA: &[(&str, &str)] = &[
    ("rcs.role", "What the messages are for. Views choose what to draw by it."),
    (
        WRITER,
        "Who writes the buffer: processes in the order of the stack, `log`, `operator` or `runtime`, separated by commas.",
    ),
    ("rcs.overlay_of", "Topic of the images on which these lie, pixel for pixel."),
    ("rcs.palette", "How a view colours the values."),
    ("rcs.classes", "Names and colours of the values of a label image, as JSON."),
    (
        "rcs.ground_truth",
        "`true` where it is the ground truth of a simulation, which only simulation and evaluation read.",
    ),
    ("rcs.delta_of", "Topic of the key frames that the messages of this channel change."),
];
