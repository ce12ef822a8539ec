# The API and the worker: one image, two commands (see docker-compose.yml).
FROM python:3.11.14-slim-bookworm AS build
WORKDIR /source
RUN python -m venv /opt/ondelette
COPY constraints.txt pyproject.toml README.md LICENSE ./
COPY app app
COPY worker worker
COPY solvers solvers
RUN /opt/ondelette/bin/pip install --no-cache-dir --constraint constraints.txt .

FROM python:3.11.14-slim-bookworm
RUN useradd --system --uid 10001 --create-home --home-dir /var/lib/ondelette ondelette
COPY --from=build /opt/ondelette /opt/ondelette
ENV PATH=/opt/ondelette/bin:$PATH \
    PYTHONUNBUFFERED=1 \
    MPLCONFIGDIR=/tmp
USER 10001
WORKDIR /var/lib/ondelette
EXPOSE 8000
CMD ["ondelette", "--help"]
