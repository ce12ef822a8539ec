"""HTTP and people: the API, the embedded service, the command line, the client. No numerics."""
