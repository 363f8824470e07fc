"""Web pages of the service, for a browser on the computer of the server."""
