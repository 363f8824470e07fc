"""The ground under all rooms: units, quantities, errors, provenance, tables and files."""
