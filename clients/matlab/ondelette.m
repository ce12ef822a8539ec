function varargout = ondelette(varargin)
%ONDELETTE  Solve an optimal-control problem on an ondelette service.
%
%   result = ONDELETTE(document) submits a job document, waits for its end and
%   fetches the result. The document is a struct, or JSON as text.
%
%   id = ONDELETTE('submit', document) only submits it.
%   result = ONDELETTE('result', id) waits for a job and fetches its result.
%   text = ONDELETTE('case', name) gives a case on board as JSON; jsondecode
%   makes a struct of it.
%
%   Options follow as names and values:
%     'Server'   address of the service ('http://127.0.0.1:8000')
%     'Key'      API key, where the service asks for one
%     'Timeout'  seconds to wait for the end of the job (3600); the job goes on
%
%   The result is a struct:
%     t, states, controls, outputs   the samples, a column for each name, as
%                                    in the MAT file of the service
%     objective, final_time          NaN where they are not finite
%     success, status, message       success only if the answer was verified
%     verification, switching        as the service tells them
%     job                            the id of the job
%
%   In a struct NaN stands for null (a free end, an open bound), the field x_
%   for the key '*'. Matrices of numbers become lists of rows, and what must be
%   a list is one even where it has one element.
%
%   Example, a double integrator in minimum time:
%     d.problem.model = struct('kind', 'first_order', 'states', {{'x', 'v'}}, ...
%       'controls', {{'u'}}, 'dynamics', struct('x', 'v', 'v', 'u'));
%     d.problem.final_time = [0.5 10];
%     d.problem.initial_state = struct('x', 0, 'v', 0);
%     d.problem.final_state = struct('x', 1, 'v', 0);
%     d.problem.bounds.u = [-1 1];
%     d.problem.objective.terminal = 'tf';
%     result = ondelette(d);
%     plot(result.t, result.states.x)
%
%   MATLAB R2017b or newer, by webread and webwrite; GNU Octave 7 or newer, by
%   the command curl, for its webwrite cannot send JSON.

  verbs = {'submit', 'result', 'case'};
  verb = 'solve';
  if ischar(varargin{1}) && any(strcmp(varargin{1}, verbs))
    verb = varargin{1};
    varargin(1) = [];
  end
  subject = varargin{1};
  service = options_of(varargin(2:end));
  switch verb
    case 'solve'
      varargout{1} = fetch(service, submit(service, subject));
    case 'submit'
      varargout{1} = submit(service, subject);
    case 'result'
      varargout{1} = fetch(service, subject);
    case 'case'
      varargout{1} = request(service, 'GET', ['/v1/cases/' subject], '');
  end
end


function service = options_of(pairs)
  service = struct('Server', 'http://127.0.0.1:8000', 'Key', '', 'Timeout', 3600);
  for k = 1:2:numel(pairs)
    if ~isfield(service, pairs{k})
      error('ondelette:option', 'unknown option %s; there are Server, Key and Timeout', pairs{k});
    end
    service.(pairs{k}) = pairs{k + 1};
  end
  service.Server = regexprep(service.Server, '/+$', '');
end


function id = submit(service, document)
  if ~ischar(document)
    document = json_of(document);
  end
  job = jsondecode(request(service, 'POST', '/v1/jobs', document));
  id = job.id;
end


function result = fetch(service, id)
  started = clock();
  final = {'succeeded', 'failed', 'cancelled'};
  while true
    job = jsondecode(request(service, 'GET', ['/v1/jobs/' id '?wait=20'], ''));
    if any(strcmp(job.status, final))
      break
    end
    if etime(clock(), started) > service.Timeout
      error('ondelette:timeout', 'job %s is still %s', id, job.status);
    end
  end
  try
    told = jsondecode(request(service, 'GET', ['/v1/jobs/' id '/result'], ''));
  catch problem
    if isempty(job.error)
      rethrow(problem);
    end
    error('ondelette:failed', 'job %s %s: %s', id, job.status, job.error.detail);
  end
  file = [tempname() '.mat'];
  remove = onCleanup(@() delete(file));
  download(service, ['/v1/jobs/' id '/result?format=mat'], file);
  result = load(file);
  kept = {'success', 'status', 'message', 'verification', 'switching'};
  for k = 1:numel(kept)
    result.(kept{k}) = told.(kept{k});
  end
  result.job = id;
end


% ---------------------------------------------------------------- JSON

function text = json_of(document)
  document.problem = prepared(document.problem);
  % MATLAB has no field of the name '*'; jsondecode calls it x_ as well.
  text = strrep(jsonencode(document), '"x_":', '"*":');
end


function part = prepared(part)
% Lists and matrices that jsonencode would write as single numbers, objects or flat lists.
  matrices = {'mass', 'damping', 'stiffness', 'input', 'inertia'};
  lists = {'coordinates', 'states', 'controls', 'flexible', 'axes', 'modes', 'coupling', 'force', ...
           'path_constraints', 'boundary_constraints', 'integrals', 'outputs', 'cases'};
  names = fieldnames(part);
  for k = 1:numel(names)
    name = names{k};
    value = part.(name);
    if any(strcmp(name, matrices)) && isnumeric(value) && ~is_mode(part)
      value = arrayfun(@(i) num2cell(value(i, :)), 1:size(value, 1), 'UniformOutput', false);
    elseif any(strcmp(name, lists)) && isnumeric(value)
      value = num2cell(value(:)');
    elseif any(strcmp(name, lists)) && ischar(value)
      value = {value};
    elseif any(strcmp(name, lists)) && isstruct(value) && ~any(strcmp(name, {'states', 'controls'}))
      value = arrayfun(@prepared, value(:)', 'UniformOutput', false);
    elseif any(strcmp(name, lists)) && iscell(value)
      value = cellfun(@prepared_if_struct, value(:)', 'UniformOutput', false);
    elseif any(strcmp(name, {'initial_state', 'final_state', 'bounds'})) && isstruct(value)
      value = structfun(@null_if_empty, value, 'UniformOutput', false);
    elseif isstruct(value) && isscalar(value)
      value = prepared(value);
    end
    part.(name) = value;
  end
end


function yes = is_mode(part)
% The damping of a structural mode is a number, not a matrix.
  yes = isfield(part, 'frequency_hz');
end


function value = prepared_if_struct(value)
  if isstruct(value)
    value = prepared(value);
  end
end


function value = null_if_empty(value)
% jsondecode reads null as [], and jsonencode writes NaN as null.
  if isempty(value)
    value = NaN;
  end
end


% ---------------------------------------------------------------- HTTP

function text = request(service, method, path, body)
% The text of an answer; what is refused for the moment is asked again, under the same key.
  key = idempotency_key();
  for attempt = 0:5
    [status, text] = send(service, method, path, body, key, '');
    if ~any(status == [429 503]) || attempt == 5
      break
    end
    pause(0.5 * 2 ^ attempt);
  end
  if status >= 400
    error('ondelette:refused', '%s', refusal(status, text));
  end
end


function download(service, path, file)
  [status, text] = send(service, 'GET', path, '', '', file);
  if status >= 400
    error('ondelette:refused', '%s', refusal(status, text));
  end
end


function text = refusal(status, body)
% What a problem document (RFC 9457) says, a line for each mistake.
  text = sprintf('HTTP status %d', status);
  try
    problem = jsondecode(body);
    text = problem.title;
    if isfield(problem, 'detail')
      text = [text ': ' problem.detail];
    end
    if isfield(problem, 'errors')
      for k = 1:numel(problem.errors)
        text = sprintf('%s\n%s: %s', text, problem.errors(k).pointer, problem.errors(k).detail);
      end
    end
  catch
    if ~isempty(body)
      text = [text ': ' body];
    end
  end
end


function [status, text] = send(service, method, path, body, key, file)
% One request. The answer goes into text, or into a file where one is named.
  if exist('OCTAVE_VERSION', 'builtin')
    [status, text] = send_by_curl(service, method, path, body, key, file);
    return
  end
  headers = {};
  if ~isempty(service.Key)
    headers(end + 1, 1:2) = {'Authorization', ['Bearer ' service.Key]};
  end
  if ~isempty(body)
    headers(end + 1, 1:2) = {'Idempotency-Key', key};
  end
  options = weboptions('Timeout', 90, 'MediaType', 'application/json', 'ContentType', 'text');
  if ~isempty(headers)
    options.HeaderFields = headers;
  end
  status = 200;
  text = '';
  try
    if ~isempty(file)
      websave(file, [service.Server path], options);
    elseif strcmp(method, 'POST')
      text = webwrite([service.Server path], body, options);
    else
      text = webread([service.Server path], options);
    end
  catch failure
    % MATLAB tells the status of a refusal in the identifier, and keeps its body to itself.
    found = regexp(failure.identifier, 'HTTP(\d+)', 'tokens', 'once');
    if isempty(found)
      rethrow(failure);
    end
    status = str2double(found{1});
    text = failure.message;
  end
end


function [status, text] = send_by_curl(service, method, path, body, key, file)
% Everything goes through files: arguments of a process are seen by all users of a machine.
  config = tempname();
  sent = tempname();
  answer = file;
  if isempty(file)
    answer = tempname();
  end
  remove = onCleanup(@() cellfun(@delete_if_there, {config, sent}));
  lines = {'silent', 'show-error', 'max-time = 90', ['url = "' service.Server path '"'], ...
           ['request = "' method '"'], ['output = "' answer '"'], 'write-out = "%{http_code}"'};
  if ~isempty(service.Key)
    lines{end + 1} = ['header = "Authorization: Bearer ' service.Key '"'];
  end
  if ~isempty(body)
    write_text(sent, body);
    lines{end + 1} = 'header = "Content-Type: application/json"';
    lines{end + 1} = ['header = "Idempotency-Key: ' key '"'];
    lines{end + 1} = ['data-binary = "@' sent '"'];
  end
  write_text(config, sprintf('%s\n', lines{:}));
  [failed, told] = system(['curl --config "' config '" 2>&1']);
  if failed
    error('ondelette:unreachable', 'no answer from %s: %s', service.Server, strtrim(told));
  end
  status = str2double(told);
  text = '';
  if isempty(file) || status >= 400
    text = fileread(answer);
    delete_if_there(answer);
  end
end


function write_text(name, text)
  handle = fopen(name, 'w');
  fwrite(handle, text);
  fclose(handle);
end


function delete_if_there(name)
  if exist(name, 'file')
    delete(name);
  end
end


function key = idempotency_key()
% Random numbers begin alike in every session; names of temporary files do not.
  [~, name] = fileparts(tempname());
  key = sprintf('%s-%.0f', name, now() * 86400e3);
end
