"""The paper's claims: studies that measure those which no other page does, and their table."""
