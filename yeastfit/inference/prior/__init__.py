"""What is known before the data: distributions of parameters, and how colonies scatter about their condition."""
