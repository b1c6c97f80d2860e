"""The studies of the papers that this project answers to: what they plot, computed anew."""
