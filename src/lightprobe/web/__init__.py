"""What the page and the service share: listening, the gate, files that come in, failures, and a pool of workers."""
