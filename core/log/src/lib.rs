//! Logs: indexed MCAP reading, writing, recovery and the time cursor.
