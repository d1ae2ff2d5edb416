//! Reads messages in order from any position.

use crate::cache::Loaded;
use crate::error::LogError;
use crate::info::{LogMessage, MessagePosition, TopicId};
use crate::log::{Log, message_at, place_of};
use crate::segment::{MessageRef, Segment};
use rcs_msg::Stamp;
use serde::{Deserialize, Serialize};
use std::cmp::{Ordering, Reverse};
use std::collections::BinaryHeap;
use std::sync::Arc;
use std::thread::JoinHandle;

/// Selects the messages of a cursor.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct CursorOptions {
    /// Only messages of these topics; `None` for all.
    pub topics: Option<Vec<TopicId>>,
    /// No message before this log time.
    pub start: Stamp,
    /// No message after this log time.
    pub end: Stamp,
}

impl Default for CursorOptions {
    /// All messages.
    fn default() -> Self {
        Self { topics: None, start: Stamp(0), end: Stamp::MAX }
    }
}

/// Position of a cursor: [`Log::cursor_at`] continues there with exactly the remaining messages.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Position {
    options: CursorOptions,
    /// The last message returned, or a position before the first.
    after: MessagePosition,
}

impl Position {
    /// The last message returned, or a position before all messages.
    pub fn place(&self) -> MessagePosition {
        self.after
    }

    /// The options of the cursor.
    pub fn options(&self) -> &CursorOptions {
        &self.options
    }
}

/// Returns messages by log time, ties in file order.
///
/// An error means that the system refuses to read a chunk; the cursor then continues after that chunk.
#[derive(Debug)]
pub struct Cursor {
    log: Log,
    position: Position,
    /// The selected topics, ascending.
    wanted: Option<Vec<u16>>,
    /// Number of segments, by first time, that have been opened or skipped.
    opened: usize,
    heads: BinaryHeap<Reverse<Front>>,
    /// The segment of the last message, which is likely to have the next one, too.
    current: Option<(u32, Arc<Loaded>)>,
    reads_ahead: bool,
    /// A segment that will be needed soon, and the thread that reads it.
    ahead: Option<(u32, Reading)>,
}

type Reading = JoinHandle<Result<Arc<Loaded>, LogError>>;

/// The next message of an open segment.
#[derive(Debug)]
struct Front {
    segment: u32,
    index: usize,
    messages: Arc<[MessageRef]>,
}

impl Front {
    fn place(&self) -> MessagePosition {
        place_of(self.segment, self.messages[self.index])
    }
}

impl PartialEq for Front {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Front {}

impl PartialOrd for Front {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Front {
    fn cmp(&self, other: &Self) -> Ordering {
        self.place().cmp(&other.place())
    }
}

impl Log {
    /// Messages in order: by log time, ties in file order.
    pub fn cursor(&self, options: CursorOptions) -> Cursor {
        let after = MessagePosition::before(options.start);
        self.cursor_after(options, after)
    }

    pub(crate) fn cursor_after(&self, options: CursorOptions, after: MessagePosition) -> Cursor {
        self.cursor_at(Position { options, after })
    }

    /// Continues at the position of another cursor on the same log.
    pub fn cursor_at(&self, position: Position) -> Cursor {
        let wanted = position.options.topics.as_ref().map(|topics| {
            let mut wanted: Vec<u16> = topics.iter().map(|topic| topic.0).collect();
            wanted.sort_unstable();
            wanted
        });
        Cursor {
            log: self.clone(),
            position,
            wanted,
            opened: 0,
            heads: BinaryHeap::new(),
            current: None,
            reads_ahead: false,
            ahead: None,
        }
    }
}

impl Cursor {
    /// The position of the cursor, from which another cursor can continue.
    pub fn position(&self) -> Position {
        self.position.clone()
    }

    /// The same cursor, which reads the next segment on a thread of its own while the messages of one are returned: from
    /// its second segment on, because many cursors return only a few messages.
    #[must_use]
    pub fn reading_ahead(self) -> Self {
        Self { reads_ahead: true, ..self }
    }

    fn wants(&self, channel: u16) -> bool {
        self.wanted.as_ref().is_none_or(|wanted| wanted.binary_search(&channel).is_ok())
    }

    /// Opens every segment that may have a message before the first message of the open segments.
    fn open_segments(&mut self) -> Result<(), LogError> {
        let inner = Arc::clone(&self.log.0);
        let last = self.position.options.end.0;
        while let Some(&index) = inner.by_first.get(self.opened) {
            let segment = &inner.segments[index as usize];
            let earliest = self.heads.peek().map_or(Stamp::MAX, |Reverse(front)| front.place().time);
            if segment.first > earliest.0 || segment.first > last {
                return Ok(());
            }
            self.opened += 1;
            if !self.needs(segment) {
                continue;
            }
            let loaded = self.load(index)?;
            let messages = Arc::clone(&loaded.messages);
            let from = messages.partition_point(|&message| place_of(index, message) <= self.position.after);
            self.push(index, from, messages);
        }
        Ok(())
    }

    /// Whether a segment may have messages that are still to be returned.
    fn needs(&self, segment: &Segment) -> bool {
        let may_hold = |wanted: &Vec<u16>| wanted.iter().any(|&id| segment.may_hold(id));
        segment.last >= self.position.after.time.0 && self.wanted.as_ref().is_none_or(may_hold)
    }

    /// Begins to read the next segment that is needed, unless one is being read.
    fn read_ahead(&mut self) {
        let inner = &self.log.0;
        let mut next = inner.by_first.iter().skip(self.opened).copied();
        let next = next.find(|&index| self.needs(&inner.segments[index as usize]));
        let Some(index) = next.filter(|_| self.ahead.is_none()) else { return };
        if inner.segments[index as usize].first > self.position.options.end.0 {
            return;
        }
        let log = self.log.clone();
        let thread = std::thread::Builder::new().name("read ahead".to_owned()).spawn(move || log.load(index));
        self.ahead = thread.ok().map(|thread| (index, thread));
    }

    fn load(&mut self, index: u32) -> Result<Arc<Loaded>, LogError> {
        if let Some((current, loaded)) = &self.current
            && *current == index
        {
            return Ok(Arc::clone(loaded));
        }
        // Released first, because the segment to load may need the memory.
        let is_first = self.current.take().is_none();
        let ahead = self.ahead.take_if(|(ahead, _)| *ahead == index);
        let loaded = match ahead.map(|(_, thread)| thread.join()) {
            Some(Ok(loaded)) => loaded?,
            _ => self.log.load(index)?,
        };
        self.current = Some((index, Arc::clone(&loaded)));
        if self.reads_ahead && !is_first {
            self.read_ahead();
        }
        Ok(loaded)
    }

    /// Queues a segment at its first selected message from `from` on.
    fn push(&mut self, segment: u32, from: usize, messages: Arc<[MessageRef]>) {
        let end = self.position.options.end.0;
        let next =
            messages[from..].iter().position(|message| message.time > end || self.wants(message.channel));
        if let Some(offset) = next
            && messages[from + offset].time <= end
        {
            self.heads.push(Reverse(Front { segment, index: from + offset, messages }));
        }
    }
}

impl Iterator for Cursor {
    type Item = Result<LogMessage, LogError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            if let Err(error) = self.open_segments() {
                return Some(Err(error));
            }
            let Reverse(front) = self.heads.pop()?;
            let Front { segment, index, messages } = front;
            self.position.after = place_of(segment, messages[index]);
            let loaded = match self.load(segment) {
                Ok(loaded) => loaded,
                // The segment is given up.
                Err(error) => return Some(Err(error)),
            };
            let message = message_at(segment, &loaded, messages[index]);
            self.push(segment, index + 1, messages);
            if let Some(message) = message {
                return Some(Ok(message));
            }
        }
    }
}
