"""Commands that are killed, run out of disk or meet a read-only folder at any moment: `make kills`."""
