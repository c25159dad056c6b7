"""Which method, stored size and spacing each lobe gets, and what that costs."""
