"""An MCP server: agents plan, check, run and explain behavior trees over the Model Context Protocol."""
