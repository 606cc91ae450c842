"""What happens when things break: kills, broken files, odd answers, failing servers, long runs."""
