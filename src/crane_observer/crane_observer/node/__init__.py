"""The nodes: messages to readings, and estimates to messages."""
