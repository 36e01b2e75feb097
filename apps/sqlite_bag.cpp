// SPDX-License-Identifier: Apache-2.0
//
// Storage sqlite3 of rosbag2: tables `topics` and `messages`.
#include <sqlite3.h>

#include <stdexcept>
#include <utility>

#include "apps/bag_file.h"

namespace covey {
namespace {

namespace fs = std::filesystem;

struct CloseDatabase {
  void operator()(sqlite3* database) const { sqlite3_close(database); }
};
struct EndStatement {
  void operator()(sqlite3_stmt* statement) const { sqlite3_finalize(statement); }
};

class Database {
 public:
  explicit Database(fs::path file) : file_(std::move(file)) {
    sqlite3* opened = nullptr;
    const int result = sqlite3_open_v2(file_.c_str(), &opened, SQLITE_OPEN_READONLY, nullptr);
    database_.reset(opened);
    if (result != SQLITE_OK) fail();
  }
  [[noreturn]] void fail() const {
    throw std::runtime_error(
        file_.string() + ": no bag of ROS 2 that can be read: " + sqlite3_errmsg(database_.get()));
  }
  [[nodiscard]] sqlite3* get() const { return database_.get(); }

 private:
  fs::path file_;
  std::unique_ptr<sqlite3, CloseDatabase> database_;
};

// The rows that answer a question. Columns count from 0, parameters from 1.
class Query {
 public:
  Query(const Database& database, const char* question) : database_(database) {
    sqlite3_stmt* prepared = nullptr;
    const int result = sqlite3_prepare_v2(database.get(), question, -1, &prepared, nullptr);
    statement_.reset(prepared);
    if (result != SQLITE_OK) database.fail();
  }
  void bind(int parameter, const std::string& value) {
    const int result =
        sqlite3_bind_text(statement_.get(), parameter, value.c_str(), -1, SQLITE_TRANSIENT);
    if (result != SQLITE_OK) database_.fail();
  }
  bool next() {
    const int result = sqlite3_step(statement_.get());
    if (result != SQLITE_ROW && result != SQLITE_DONE) database_.fail();
    return result == SQLITE_ROW;
  }
  [[nodiscard]] std::int64_t integer(int column) const {
    return sqlite3_column_int64(statement_.get(), column);
  }
  [[nodiscard]] std::string text(int column) const {
    const unsigned char* const value = sqlite3_column_text(statement_.get(), column);
    return value == nullptr ? "" : reinterpret_cast<const char*>(value);
  }
  [[nodiscard]] Bytes bytes(int column) const {
    const auto* const first =
        static_cast<const std::uint8_t*>(sqlite3_column_blob(statement_.get(), column));
    const int size = sqlite3_column_bytes(statement_.get(), column);
    return first == nullptr ? Bytes() : Bytes(first, first + size);
  }

 private:
  const Database& database_;
  std::unique_ptr<sqlite3_stmt, EndStatement> statement_;
};

class SqliteBag : public BagFile {
 public:
  explicit SqliteBag(const fs::path& file) : database_(file) {}

  [[nodiscard]] std::vector<BagTopic> topics() const override {
    Query query(database_,
                "SELECT name, type, (SELECT COUNT(*) FROM messages "
                "WHERE messages.topic_id = topics.id) FROM topics "
                "WHERE serialization_format = 'cdr'");
    std::vector<BagTopic> topics;
    while (query.next())
      topics.push_back({query.text(0), query.text(1), static_cast<std::size_t>(query.integer(2))});
    return topics;
  }

  [[nodiscard]] std::int64_t begin_ns() const override {
    Query query(database_, "SELECT MIN(timestamp) FROM messages");
    return query.next() ? query.integer(0) : 0;
  }

  void read(const std::string& topic, const TakeMessage& take) const override {
    Query query(database_,
                "SELECT data FROM messages JOIN topics ON topics.id = messages.topic_id "
                "WHERE topics.name = ?1 ORDER BY messages.timestamp, messages.id");
    query.bind(1, topic);
    while (query.next()) take(query.bytes(0));
  }

 private:
  Database database_;
};

}  // namespace

std::unique_ptr<BagFile> open_sqlite_bag(const fs::path& file) {
  return std::make_unique<SqliteBag>(file);
}

}  // namespace covey
