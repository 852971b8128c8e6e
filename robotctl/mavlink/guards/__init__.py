"""Which commands count: handling of copies, late ones and those of a link that was down."""
