# syntax=docker/dockerfile:1
# docker build -t ensemble-plan . && docker run --rm -v "$PWD:/home/planner/work" ensemble-plan my_map.yaml
FROM python:3.12-slim AS build
WORKDIR /source
COPY pyproject.toml README.md LICENSE ./
COPY configs configs
COPY src src
RUN python -m venv /opt/planner && /opt/planner/bin/pip install --no-cache-dir .

FROM python:3.12-slim
RUN useradd --create-home --uid 1000 planner
COPY --from=build /opt/planner /opt/planner
ENV PATH=/opt/planner/bin:$PATH MPLBACKEND=Agg
USER 1000:1000
WORKDIR /home/planner/work
ENTRYPOINT ["ensemble-plan"]
CMD ["--help"]
