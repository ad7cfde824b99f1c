"""What the columns of a log say of each other, before any dynamics: digits, noise, rates."""
