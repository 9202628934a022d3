"""What keeps strangers out: keys, seals on messages, and file paths that stay in their folder; see docs/security.md."""
