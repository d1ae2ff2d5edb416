//! Reads the parts of a log independently of each other, for readers on several threads.
//!
//! A [`Cursor`](crate::Cursor) gives messages in their total order, copied out of their chunks, on one thread. Who needs
//! one field of very many messages takes the parts as they are stored, and orders what it made of them.

use crate::cache::Loaded;
use crate::cursor::CursorOptions;
use crate::error::LogError;
use crate::indexed::indexed;
use crate::info::{MessagePosition, TopicId};
use crate::log::{Log, place_of};
use crate::record::{HEAD, Head, MESSAGE_HEAD, MessageHead};
use crate::segment::MessageRef;
use rcs_msg::Stamp;

/// A part of a log that is stored together. Parts may overlap in time.
#[derive(Clone, Copy, Debug)]
pub struct Piece {
    segment: u32,
    /// No message of it is earlier.
    pub first: Stamp,
    /// No message of it is later.
    pub last: Stamp,
}

/// A message in the memory of its piece.
#[derive(Clone, Copy, Debug)]
pub struct PieceMessage<'a> {
    /// Its topic.
    pub topic: TopicId,
    /// When it was recorded.
    pub log_time: Stamp,
    /// Its position in the order of all messages.
    pub place: MessagePosition,
    /// The encoded message.
    pub data: &'a [u8],
}

impl Log {
    /// The pieces that may have messages of these options, by their first time.
    pub fn pieces(&self, options: &CursorOptions) -> Vec<Piece> {
        let mut pieces = Vec::new();
        for &index in &self.0.by_first {
            let segment = &self.0.segments[index as usize];
            let inside = segment.first <= options.end.0 && segment.last >= options.start.0;
            let topics = options.topics.as_ref();
            if inside && topics.is_none_or(|topics| topics.iter().any(|topic| segment.may_hold(topic.0))) {
                let (first, last) = (Stamp(segment.first), Stamp(segment.last));
                pieces.push(Piece { segment: index, first, last });
            }
        }
        pieces
    }

    /// Calls `take` for the messages of a piece that the options select, in order. The piece is not kept in the cache of
    /// the log.
    pub fn read_piece(
        &self,
        piece: &Piece,
        options: &CursorOptions,
        mut take: impl FnMut(PieceMessage<'_>),
    ) -> Result<(), LogError> {
        let loaded = self.load_once(piece.segment)?;
        let wanted = options.topics.as_ref().map(|topics| {
            let mut wanted: Vec<u16> = topics.iter().map(|topic| topic.0).collect();
            wanted.sort_unstable();
            wanted
        });
        for &message in loaded.messages.iter() {
            let wants = wanted.as_ref().is_none_or(|wanted| wanted.binary_search(&message.channel).is_ok());
            if wants
                && (options.start.0..=options.end.0).contains(&message.time)
                && let Some(message) = message_in(piece.segment, &loaded, message)
            {
                take(message);
            }
        }
        Ok(())
    }
}

impl Log {
    /// Calls `take` for the times of the messages of a piece that the options select, in order, by the index behind it:
    /// the piece itself is not read. `false`, without a call, if it has no index, or one that is damaged or too large.
    pub fn read_times(
        &self,
        piece: &Piece,
        options: &CursorOptions,
        mut take: impl FnMut(TopicId, MessagePosition),
    ) -> Result<bool, LogError> {
        let inner = &*self.0;
        let segment = &inner.segments[piece.segment as usize];
        let topics = options.topics.as_ref();
        let wants = |channel| topics.is_none_or(|topics| topics.contains(&TopicId(channel)));
        let Some(found) = indexed(&inner.source, &inner.parts, segment, wants)? else { return Ok(false) };
        let is_selected = |message: &&MessageRef| (options.start.0..=options.end.0).contains(&message.time);
        for message in found.iter().filter(is_selected) {
            take(TopicId(message.channel), place_of(piece.segment, *message));
        }
        Ok(true)
    }
}

fn message_in(segment: u32, loaded: &Loaded, message: MessageRef) -> Option<PieceMessage<'_>> {
    let record = loaded.contents.get(message.offset as usize..)?;
    let length = usize::try_from(Head::read(record)?.length()).ok()?;
    let body = record.get(HEAD..length)?;
    let head = MessageHead::read(body)?;
    Some(PieceMessage {
        topic: TopicId(message.channel),
        log_time: Stamp(head.log_time),
        place: place_of(segment, message),
        data: body.get(MESSAGE_HEAD..)?,
    })
}
