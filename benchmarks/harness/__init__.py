"""What the benchmark scripts share: data, measuring in fresh processes, the peers' search, tables."""
