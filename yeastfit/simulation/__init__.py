"""Growing colonies, and photographs of them with known parameters."""
