"""The painter of the skins of the embedded bodies: what is where, and in which colour."""
