"""The ECU on the bus: mailboxes, bits and scaling, checksums and counters, frames to send."""
