"""The machine: voltage equation, terms, flux maps, frames and holds."""
