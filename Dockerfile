# The API and the worker: one image, two commands (see docker-compose.yml).
FROM python:3.11.14-slim-bookworm AS build
WORKDIR /source
RUN python -m venv /opt/ondelette
COPY constraints.txt pyproject.toml README.md LICENSE ./
# What is needed first: this layer stays while only our own code changes.
RUN python -c "import tomllib; print(*tomllib.load(open('pyproject.toml', 'rb'))['project']['dependencies'], sep='\n')" \
      > needed.txt \
 && /opt/ondelette/bin/pip install --no-cache-dir --constraint constraints.txt --requirement needed.txt
COPY app app
COPY worker worker
COPY solvers solvers
RUN /opt/ondelette/bin/pip install --no-cache-dir --no-deps .

FROM python:3.11.14-slim-bookworm
RUN groupadd --system --gid 10001 ondelette \
 && useradd --system --uid 10001 --gid ondelette --create-home --home-dir /var/lib/ondelette ondelette \
 && install --directory --owner ondelette --group ondelette /var/lib/ondelette/results
COPY --from=build /opt/ondelette /opt/ondelette
# Nothing is written but to /tmp, so that the root may be read-only.
ENV PATH=/opt/ondelette/bin:$PATH \
    PYTHONUNBUFFERED=1 \
    PYTHONDONTWRITEBYTECODE=1 \
    MPLCONFIGDIR=/tmp
USER 10001:10001
WORKDIR /var/lib/ondelette
EXPOSE 8000
CMD ["ondelette", "--help"]
