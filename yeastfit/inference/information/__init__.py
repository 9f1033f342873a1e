"""Fisher information: what data can tell, and what to measure next."""
