"""Files: models in TOML and JSON, tables in CSV and npz."""
