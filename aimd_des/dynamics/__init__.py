"""How an agent behaves, once for all ways of running: growth, response, average, clock, loss compensation."""
