//! Buffers: named mailboxes with headers, readers, writers, taps and overrides.
