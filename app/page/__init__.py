"""The page, built from `page/` by `make page`: static files, served by `app.routes.pages`."""
